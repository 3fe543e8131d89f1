"""Where the time goes until a command has its result, with an empty and with a filled compilation cache."""

import pathlib
import tempfile
from collections.abc import Mapping, Sequence

from ..commands import WHOLE, watch_command
from ..data import EXAMPLE
from ..table import Section
from ..watched import AT, REST

COMMANDS = ("fit", "check", "simulate")
FILLED = 2
"""Runs with a filled cache, of which the shortest counts."""
KEPT, SMALL = "number of programs kept whole", "number of small programs in JAX's cache"


def measure() -> Section:
    """Watches commands on the example that ships, each in a process of its own."""
    commands = {command: [command, str(EXAMPLE / "study.toml")] for command in COMMANDS}
    with tempfile.TemporaryDirectory() as name:
        return watch_commands("Until the first answer", _ABOUT, commands, pathlib.Path(name))


def watch_commands(title: str, about: str, commands: Mapping[str, Sequence[str]], root: pathlib.Path) -> Section:
    """A table of commands by their names: the s that each spends at what."""
    columns = [f"{command}, {cache}" for command in commands for cache in ("empty", "filled")]
    section = Section(title, about, ("s of", *columns))
    runs = [each for name, arguments in commands.items() for each in _watch(list(arguments), root / name)]
    runs = [{**run, REST: run[WHOLE] - sum(run.get(each, 0.0) for each in AT)} for run in runs]
    for what in (*AT, REST, WHOLE):
        section.add(what, *(f"{run.get(what, 0.0):.2f}" for run in runs))
    for what in (KEPT, SMALL):
        section.add(what, *(f"{run[what]:.0f}" if what in run else "" for run in runs))
    return section


def _watch(arguments: list[str], folder: pathlib.Path) -> tuple[dict[str, float], dict[str, float]]:
    """A command with an empty cache, and with what that has left."""
    folder.mkdir()
    cache = folder / "cache"
    empty, *filled = (
        watch_command([*arguments, "--out", str(folder / f"{number}")], cache, folder / f"{number}.json")
        for number in range(1 + FILLED)
    )
    return {**empty, **_programs(cache)}, min(filled, key=lambda run: run[WHOLE])


def _programs(cache: pathlib.Path) -> dict[str, int]:
    """How many a cache holds."""
    return {KEPT: len(list(cache.rglob("*.program"))), SMALL: len(list(cache.rglob("*-cache")))}


_ABOUT = (
    "Whole processes, from typing the command to its end, on the example that ships. Twice in a hundredth of a second "
    "the stack of the thread that the user waits for is looked at; what other threads do meanwhile (compilation of "
    "programs for later) is not counted. The start of Python is in the rest."
)
