"""Where the time goes until a command has its result, with an empty and with a filled compilation cache."""

import pathlib
import tempfile

from ..commands import WHOLE, watch_command
from ..data import EXAMPLE
from ..table import Section
from ..watched import AT, REST

COMMANDS = ("fit", "check", "simulate")
FILLED = 2
"""Runs with a filled cache, of which the shortest counts."""


def measure() -> Section:
    """Watches commands on the example that ships, each in a process of its own."""
    columns = [f"{command}, {cache}" for command in COMMANDS for cache in ("empty", "filled")]
    section = Section("Until the first answer", _ABOUT, ("s of", *columns))
    with tempfile.TemporaryDirectory() as name:
        runs = [each for command in COMMANDS for each in _watch(command, pathlib.Path(name) / command)]
    runs = [{**run, REST: run[WHOLE] - sum(run.get(each, 0.0) for each in AT)} for run in runs]
    for what in (*AT, REST, WHOLE):
        section.add(what, *(f"{run.get(what, 0.0):.2f}" for run in runs))
    return section


def _watch(command: str, folder: pathlib.Path) -> tuple[dict[str, float], dict[str, float]]:
    """A command with an empty cache, and with what that has left."""
    folder.mkdir()
    study = [str(EXAMPLE / "study.toml")]
    empty, *filled = (
        watch_command([command, *study, "--out", str(folder / f"{number}")], folder, folder / f"{number}.json")
        for number in range(1 + FILLED)
    )
    return empty, min(filled, key=lambda run: run[WHOLE])


_ABOUT = (
    "Whole processes, from typing the command to its end, on the example that ships. Twice in a hundredth of a second "
    "the stack of the thread that the user waits for is looked at; what other threads do meanwhile (compilation of "
    "programs for later) is not counted. The start of Python is in the rest."
)
