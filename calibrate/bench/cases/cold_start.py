"""From typing the command to its result, with an empty and with a filled compilation cache."""

import pathlib
import tempfile

from ..commands import run_command
from ..table import Section, seconds, times

WARM_ROUNDS = 2
COMMANDS = ("fit", "check", "simulate", "tolerance", "sensitivity", "tune", "reproduce")
"""Without a study each but the last, which reads none, takes an example that ships."""
COLUMNS = ("command", "compilation cache", "time", "ratio")


def measure() -> Section:
    """Times commands on the examples that ship, each in a process of its own."""
    section = Section("Cold start", _ABOUT, COLUMNS)
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for command in COMMANDS:
            # Each begins with a cache that holds nothing of the others.
            cold, *runs = (
                run_command([command, "--out", str(root / f"{command} {i}")], root / command)
                for i in range(1 + WARM_ROUNDS)
            )
            section.add(f"python -m calibrate {command}", "empty", seconds(cold), times(cold / min(runs)))
            section.add(f"python -m calibrate {command}", "filled", seconds(min(runs)), times(1.0))
        helps = [run_command(["--help"], root) for _ in range(WARM_ROUNDS + 1)]
    section.add("python -m calibrate --help", "not used", seconds(min(helps[1:])), "")
    return section


_ABOUT = (
    "Whole processes with imports, compilation, computation and report of the examples that ship; the caches are "
    f"folders that this benchmark makes. Best of {WARM_ROUNDS}, but for the empty cache, which happens once."
)
