"""Pivot and linkage of a turbine's vanes found from loops by the commands, and what loops do not tell."""

import json
import pathlib
import tempfile
from collections.abc import Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.control import POSITION_NOISE
from vgtjax.parts import solve_table

from ..commands import run_command
from ..nozzle_loops import GAUGE, RATE, SECONDS, TRUE, record, write_study
from ..table import Section, seconds
from ..timing import interleave

UNTOLD = ("vane_force.nozzle.*", "vane_force.linkage.*")
"""What `check` is asked about besides."""
ROUNDS = 3


def measure() -> Section:
    """Simulates loops, fits them, and asks what they tell."""
    section = Section(
        "Pivot and linkage of the vanes from loops",
        f"{len(GAUGE)} loops of {SECONDS:g} s at {RATE:g} Hz with {', '.join(f'{each / 1e5:g}' for each in GAUGE)} bar "
        f"gauge before the turbine and LuGre friction, simulated by this package's own simulator, with noise of "
        f"{POSITION_NOISE * 1e6:g} um.",
        ("parameter", "true", "start", "found", "standard error", "off by, in errors"),
    )
    traces = record(TRUE)
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        _fit(section, root, traces)
        _check(section, root, traces)
    section.notes.append(_cost_of_tables(vgtjax.Turbine(), traces))
    return section


def _fit(section: Section, root: pathlib.Path, traces: Sequence[vgtjax.Trace]) -> None:
    """Rows of what the command `fit` finds, what it says of it, and its time with an empty cache."""
    out = root / "fit"
    took = run_command(["fit", str(_study(root / "known", traces, list(TRUE))), "--out", str(out)], root)
    found = json.loads((out / "parameters.json").read_text())["parameters"]
    summary = json.loads((out / "summary.json").read_text())
    for entry, true in TRUE.items():
        value, error, first = (found[entry][field] for field in ("value", "std_error", "initial"))
        section.add(entry, f"{true:g}", f"{first:g}", f"{value:.5g}", f"{error:.2g}", f"{(value - true) / error:+.1f}")
    steps, said = summary["iterations"], summary["certificate"]["sentence"]
    section.notes.append(f"`fit` took {seconds(took)} with an empty cache, {steps} steps; {said}.")


def _check(section: Section, root: pathlib.Path, traces: Sequence[vgtjax.Trace]) -> None:
    """What the command `check` says of them with all of nozzle and linkage free, and its time behind a fit."""
    out = root / "check"
    took = run_command(["check", str(_study(root / "all", traces, [*TRUE, *UNTOLD])), "--out", str(out)], root)
    section.notes.append(f"With all of nozzle and linkage free `check` took {seconds(took)}, and says:")
    section.notes += [f"{each}." for each in json.loads((out / "summary.json").read_text())["sentences"]]


def _study(folder: pathlib.Path, traces: Sequence[vgtjax.Trace], free: Sequence[str]) -> pathlib.Path:
    folder.mkdir()
    return write_study(folder, traces, free)


def _cost_of_tables(turbine: vgtjax.Turbine, traces: Sequence[vgtjax.Trace]) -> str:
    """What a trial of the fit takes but for the loops themselves, in words."""
    rows = np.asarray(turbine.rows(*(trace.drive() for trace in traces)))
    tables = {"whole": np.ones_like(rows), "read": rows}
    timings, _ = interleave(
        {name: partial(solve_table, turbine.stage, jnp.asarray(each)) for name, each in tables.items()}, ROUNDS
    )
    whole, read = (seconds(timings[name].median) for name in tables)
    return f"A table takes {whole}; at the {np.sum(rows)} of {rows.size} pressures that these loops come to, {read}."
