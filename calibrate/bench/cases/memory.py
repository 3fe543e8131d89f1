"""The memory of ever larger studies of a population."""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
from typing import Any

from ...output.files import SUMMARY
from ..commands import environment
from ..table import Section, seconds

SIZES = (1_000, 10_000, 100_000, 1_000_000)
STUDY = """name = "memory"
[experiments]
turbine_pressure = [0]
loop_seconds = 2
steps = []
[population]
vary = ["diaphragm.stiffness", "diaphragm.preload", "friction.*"]
[tolerance]
samples = {size}
precision = "single"
"""
BASES = (200, 1_000, 5_000, 25_000)
"""Base points of a sensitivity study; each is as many simulations as there are quantities, and two."""
RANKED = """name = "memory"
[experiments]
turbine_pressure = [0]
loop_seconds = 2
steps = [80]
[population]
vary = ["diaphragm.stiffness", "diaphragm.preload", "friction.*"]
[sensitivity]
base = {size}
"""


def measure() -> Section:
    """Peak memory and time of whole commands of growing size, each a process of its own."""
    about = (
        "`python -m calibrate tolerance` in single precision, a loop of 2 s for every actuator, and `sensitivity` with "
        "a step beside it, whose curve is kept of all; whole commands, programs in the cache."
    )
    section = Section("Memory", about, ("command", "simulations", "peak memory", "time", "a second"))
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for command, sizes, study in (("tolerance", SIZES, STUDY), ("sensitivity", BASES, RANKED)):
            _whole_command(folder, command, study.format(size=sizes[0]))  # compiles
            for size in sizes:
                peak, wall, summary = _whole_command(folder, command, study.format(size=size))
                count = summary["samples" if command == "tolerance" else "simulations"]
                section.add(command, f"{count:,}", f"{peak:.0f} MB", seconds(wall), f"{count / wall:.0f}")
    return section


_CHILD = """
import json, resource, subprocess, sys, time
began = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(json.dumps([peak * (1 if sys.platform == "darwin" else 1024) / 1e6, time.perf_counter() - began]))
"""


def _whole_command(folder: pathlib.Path, command: str, text: str) -> tuple[float, float, dict[str, Any]]:
    """Peak of resident memory in MB, seconds, and the summary; a process in between, as the peak is over all children
    so far."""
    study, out = folder / "study.toml", folder / "out"
    study.write_text(text, encoding="utf-8")
    called = [sys.executable, "-m", "calibrate", command, str(study), "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, *called],
        check=True,
        capture_output=True,
        text=True,
        env=environment(folder),
    )
    peak, wall = json.loads(done.stdout)
    summary = json.loads((out / SUMMARY).read_text(encoding="utf-8"))
    shutil.rmtree(out)
    return peak, wall, summary
