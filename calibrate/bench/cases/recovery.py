"""Many starts, and recovery on campaigns whose noise, timing or structure is not what a fit assumes."""

import dataclasses
import json
import pathlib
import tempfile
from collections.abc import Sequence
from typing import Any

import numpy as np

from vgtjax.estimation import REACHED

from ..campaigns import FAULTS, Fault, draw_unit, record, write_csv
from ..commands import run_command
from ..data import EXAMPLE
from ..table import Section, seconds

STARTS = 64
CAMPAIGNS = 64
SEED = 7200


@dataclasses.dataclass(frozen=True)
class Case:
    """A campaign of the benchmarks' plant with a fault, and what its study says besides."""

    name: str
    fault: Fault
    more: str = ""


CASES = (
    Case("noise of the position behind 40 Hz", FAULTS[3]),
    Case("duty 4 ms late", FAULTS[1]),
    Case("friction by Dahl, which the plant does not have", FAULTS[0], '[components]\nfriction = "dahl"\n'),
)


def measure() -> Section:
    """Runs the commands `fit` and `recover` as a user does."""
    section = Section(
        "Many starts, and recovery on one's own data",
        f"Commands in processes of their own, programs in the cache; {STARTS} starts, up to a factor of 1.5 off, on "
        f"62 s at 1 kHz, and {CAMPAIGNS} campaigns of a recovery, on the example and on 31 s at 1 kHz, of an actuator "
        "simulated by the hard-switching plant of these benchmarks (RK4, 10 us).",
        ("what", "wall time", "outcome"),
    )
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        study = _study(folder, "starts", (FAULTS[0], FAULTS[0]), f"[fit]\nstarts = {STARTS}\n")
        section.add(f"{STARTS} starts", *_starts(study, folder))
        section.add(f"{CAMPAIGNS} campaigns of the example", *_recovered(EXAMPLE / "study.toml", folder, "example"))
        for number, case in enumerate(CASES):
            study = _study(folder, f"case_{number}", (case.fault,), case.more)
            section.add(f"{CAMPAIGNS} campaigns, {case.name}", *_recovered(study, folder, f"of case {number}"))
    section.notes.append(
        "A recovery knows its own model only: intervals that hold its own truth say nothing of a wrong structure, as "
        "its report says; `compare` is for that."
    )
    return section


def _study(folder: pathlib.Path, name: str, faults: Sequence[Fault], more: str) -> pathlib.Path:
    """A study of one unit with a campaign for each fault."""
    rng, place = np.random.default_rng(SEED), folder / name
    place.mkdir()
    unit = draw_unit(rng)
    for number, fault in enumerate(faults):
        for trace in record(unit, rng, fault):
            write_csv(trace, place / f"{trace.name}_{number}.csv")
    study = place / "study.toml"
    study.write_text(f'[[trace]]\nfile = "*.csv"\n{more}', encoding="utf-8")
    return study


def _starts(study: pathlib.Path, folder: pathlib.Path) -> tuple[str, str]:
    """s of a second run, and how the starts of it ended."""
    for place in ("first", "second"):
        took = run_command(["fit", str(study), "--out", str(folder / place)], folder)
    found = _summary(folder / "second")
    reached = [each["cost"] for each in found["starts"] if each["status"] in REACHED]
    same = sum(2 * found["measurements"] * (cost - min(reached)) < 1 for cost in reached)
    return seconds(took), f"{same} of {len(found['starts'])} within one of chi^2 of the best"


def _recovered(study: pathlib.Path, folder: pathlib.Path, name: str) -> tuple[str, str]:
    """s of a recovery from what a fit found, and what it said of all intervals."""
    fitted, out = folder / f"fit {name}", folder / f"recovery {name}"
    run_command(["fit", str(study), "--out", str(fitted)], folder)
    parameters = ["--parameters", str(fitted / "parameters.json")]
    took = run_command(["recover", str(study), *parameters, "--campaigns", str(CAMPAIGNS), "--out", str(out)], folder)
    return seconds(took), "; ".join(_summary(out)["sentences"][:-1])


def _summary(folder: pathlib.Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))
