"""What a fleet takes from its records to values that are signed: `identify` and `fit` of many units, whole commands."""

import pathlib
import tempfile

import numpy as np

from ..campaigns import draw_unit, record_end_of_line, write_csv
from ..commands import run_command
from ..table import Section, seconds

COUNTS = (4, 20)
SEED = 2026
STUDY = '[[trace]]\nfile = "unit_*.csv"\nunit = "{stem:7}"\n'


def measure() -> Section:
    """Times both commands, with an empty and with a filled compilation cache."""
    section = Section("A fleet", _ABOUT, ("units", "compilation cache", "identify", "fit", "together"))
    with tempfile.TemporaryDirectory() as name:
        root = pathlib.Path(name)
        for count in COUNTS:
            study = write_study(root / f"{count} units", count)
            for number, cache in enumerate(("empty", "filled")):
                took = _run(study, root / f"out {count} {number}", root / f"cache {count}")
                section.add(str(count), cache, *map(seconds, (*took, sum(took))))
    return section


_ABOUT = (
    "Whole processes. Every unit has three slow loops of 30 s at 100 Hz and random levels of 5 s at 500 Hz by the "
    "hard-switching plant of these benchmarks, without exhaust gas; fits begin at what was identified, and write "
    "values, intervals, profiles and reports."
)


def write_study(folder: pathlib.Path, count: int) -> pathlib.Path:
    """Records of so many units in a new folder, and the study that reads them."""
    folder.mkdir()
    rng = np.random.default_rng(SEED)
    for unit in range(1, count + 1):
        for trace in record_end_of_line(draw_unit(rng), rng):
            write_csv(trace, folder / f"unit_{unit:02d}_{trace.name}.csv")
    study = folder / "study.toml"
    study.write_text(STUDY, encoding="utf-8")
    return study


def _run(study: pathlib.Path, out: pathlib.Path, cache: pathlib.Path) -> tuple[float, float]:
    """s that each command took."""
    identified = out / "identified"
    out.mkdir()
    first = run_command(["identify", str(study), "--out", str(identified)], cache)
    following = ["fit", str(study), "--parameters", str(identified), "--out", str(out / "fitted")]
    return first, run_command(following, cache)
