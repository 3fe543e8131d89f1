"""Whether a fit that is killed again and again ends where one does that is left alone."""

import json
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import time

import numpy as np

from ...output.files import PROGRESS
from ..campaigns import FAULTS, draw_unit, record, write_csv
from ..table import Section

KILLS, UNITS = 10, 3
SEED = 41
EARLIEST, LATEST = 0.5, 0.95
"""s after its start, and part of the time of an undisturbed run, between which a run is killed."""


def measure() -> Section:
    """Fits some units to the end, and with `SIGKILL` at random moments, each time begun again."""
    section = Section("Killed again and again", _ABOUT, ("kills", "after a saved step", "runs", "largest difference"))
    rng, kills, saved, differences = random.Random(SEED), 0, 0, list[float]()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        study = _write_study(folder)
        _finish(study, folder, "first")  # fills the cache
        began = time.perf_counter()
        _finish(study, folder, "whole")
        longest = LATEST * (time.perf_counter() - began)
        while kills < KILLS:
            out = f"killed {len(differences)}"
            while kills < KILLS and _kill(study, folder, out, rng.uniform(EARLIEST, longest)):
                kills += 1
                saved += any((folder / out).rglob(PROGRESS))
            _finish(study, folder, out)
            differences.append(_difference(folder / "whole", folder / out))
    section.add(str(kills), str(saved), str(len(differences)), f"{max(differences):.1e}")
    return section


_ABOUT = (
    f"A fit of {UNITS} units side by side, two traces each of the benchmarks' plant, ended by SIGKILL {KILLS} times at "
    "random moments and begun again; the largest relative difference of a parameter from those of an undisturbed run. "
    "A run that came to its end first is followed by another."
)


def _write_study(folder: pathlib.Path) -> pathlib.Path:
    rng = np.random.default_rng(SEED)
    for unit in range(1, UNITS + 1):
        for trace in record(draw_unit(rng), rng, FAULTS[0])[1:3]:
            write_csv(trace, folder / f"unit_{unit}_{trace.name}.csv")
    study = folder / "study.toml"
    study.write_text('[[trace]]\nfile = "*.csv"\nunit = "{stem:6}"\n', encoding="utf-8")
    return study


def _start(study: pathlib.Path, folder: pathlib.Path, out: str) -> subprocess.Popen:
    # Not the flags that configure() has put into this process's environment; the command sets its own.
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    environment["XDG_CACHE_HOME"] = str(folder / "cache")
    command = [sys.executable, "-m", "calibrate", "fit", str(study), "--out", str(folder / out)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _finish(study: pathlib.Path, folder: pathlib.Path, out: str) -> None:
    status = _start(study, folder, out).wait()
    if status != 0:
        raise RuntimeError(f"the fit into '{out}' ended with status {status}")


def _kill(study: pathlib.Path, folder: pathlib.Path, out: str, seconds: float) -> bool:
    """Whether there was something to kill after so many seconds."""
    run = _start(study, folder, out)
    try:
        run.wait(seconds)
    except subprocess.TimeoutExpired:
        run.kill()
        run.wait()
        return True
    return False


def _difference(whole: pathlib.Path, killed: pathlib.Path) -> float:
    """The largest relative one of all values of all units."""
    largest = 0.0
    for unit in range(1, UNITS + 1):
        one, other = (
            json.loads((folder / f"unit_{unit}" / "parameters.json").read_text(encoding="utf-8"))["parameters"]
            for folder in (whole, killed)
        )
        for name in one:
            value, again = np.asarray(one[name]["value"], float), np.asarray(other[name]["value"], float)
            apart = np.abs(again - value) / np.maximum(np.abs(value), 1e-300)
            largest = max(largest, float(np.max(apart, initial=0.0)))
    return largest
