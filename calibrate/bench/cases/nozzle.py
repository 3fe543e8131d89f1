"""Pivot and linkage of a turbine's vanes found from loops: what is found, how well, and what loops cannot tell."""

import time
from collections.abc import Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.assurance import examine
from vgtjax.identification import plan_fit
from vgtjax.parts import solve_table

from ..nozzle_loops import GAUGE, NOISE, RATE, SECONDS, TRUE, record
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
        f"{NOISE * 1e6:g} um.",
        ("parameter", "true", "start", "found", "standard error", "off by, in errors"),
    )
    turbine, traces = vgtjax.Turbine(), record(TRUE)
    start = vgtjax.MechanicalActuator(vane_force=turbine)
    began = time.perf_counter()
    found = vgtjax.fit(start, traces, free=list(TRUE))
    took = time.perf_counter() - began
    rows = zip(found.task.selection.entries, found.values.tolist(), found.std_errors.tolist(), strict=True)
    for entry, value, error in rows:
        true, first = TRUE[entry], float(vgtjax.get_parameter(start, entry))
        section.add(entry, f"{true:g}", f"{first:g}", f"{value:.5g}", f"{error:.2g}", f"{(value - true) / error:+.1f}")
    section.notes.append(f"The fit took {seconds(took)} with compilation, {found.progress.iteration} steps.")
    section.notes.append(_cost_of_tables(turbine, traces))
    section.notes += [f"With all of nozzle and linkage free: {each}." for each in untold(start, traces)]
    return section


def _cost_of_tables(turbine: vgtjax.Turbine, traces: Sequence[vgtjax.Trace]) -> str:
    """What a trial of the fit takes but for the loops themselves, in words."""
    rows = np.asarray(turbine.rows(*(trace.drive() for trace in traces)))
    tables = {"whole": np.ones_like(rows), "read": rows}
    timings, _ = interleave(
        {name: partial(solve_table, turbine.stage, jnp.asarray(each)) for name, each in tables.items()}, ROUNDS
    )
    whole, read = (seconds(timings[name].median) for name in tables)
    return f"A table takes {whole}; at the {np.sum(rows)} of {rows.size} pressures that these loops come to, {read}."


def untold(model: vgtjax.MechanicalActuator, traces: Sequence[vgtjax.Trace]) -> list[str]:
    """What traces cannot tell of a nozzle, in the sentences of `check`."""
    return examine(plan_fit(model, traces, free=[*TRUE, *UNTOLD])).sentences
