"""From typing the command to its result, with an empty and with a filled compilation cache."""

import os
import pathlib
import subprocess
import sys
import tempfile
import time

from ..table import Section, seconds, times

WARM_ROUNDS = 2
COLUMNS = ("command", "compilation cache", "time", "ratio")


def measure() -> Section:
    """Times `fit` on the example that ships, and `--help`, in processes of their own."""
    section = Section("Cold start", _ABOUT, COLUMNS)
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        cold = _run(["fit", "--out", str(root / "cold")], root)
        runs = [_run(["fit", "--out", str(root / f"warm {i}")], root) for i in range(WARM_ROUNDS)]
        helps = [_run(["--help"], root) for _ in range(WARM_ROUNDS + 1)]
    warm, helped = min(runs), min(helps[1:])
    section.add("python -m calibrate fit", "empty", seconds(cold), times(cold / warm))
    section.add("python -m calibrate fit", "filled", seconds(warm), times(1.0))
    section.add("python -m calibrate --help", "not used", seconds(helped), "")
    return section


_ABOUT = (
    "Whole processes with imports, compilation, fit and report of the example that ships; the cache is a folder that "
    f"this benchmark makes. Best of {WARM_ROUNDS}, but for the empty cache, which happens once."
)


def _run(arguments: list[str], cache: pathlib.Path) -> float:
    # Not the flags that configure() has put into this process's environment; the command sets its own.
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    environment["XDG_CACHE_HOME"] = str(cache / "cache")
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "calibrate", *arguments], env=environment, capture_output=True, text=True
    )
    if done.returncode != 0:
        raise RuntimeError(f"calibrate {arguments[0]} ended with status {done.returncode}: {done.stderr.strip()}")
    return time.perf_counter() - began
