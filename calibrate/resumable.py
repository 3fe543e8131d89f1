"""The skeleton of a command: it owns a folder, does what is not done yet, and goes on where it was interrupted.

The report is written last, so a folder with a report is finished.
"""

import dataclasses
import pathlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, TypeVar

import numpy as np

from vgtjax import InputError, SimulationError

from .output.console import console, say_notes
from .output.files import PROGRESS, REPORT, SUMMARY, claim, read_json, release, write_json, write_text
from .processes import agree, leads, together
from .study.units import Job, Unit

Summaries = dict[str | None, dict[str, Any]]
"""Contents of `summary.json` by unit."""
Folders = Sequence[tuple[Unit, pathlib.Path]]
"""Units, each with its folder."""
P = TypeVar("P", bound=Any)
"""A dataclass of numbers and tuples that says where a computation stands, among them its `iteration`."""


def run_once(out: pathlib.Path, command: str, fingerprint: str, compute: Callable[[], None]) -> None:
    """Claims a folder and computes, unless it holds the results already; all processes of a run do the same."""

    def check() -> None:
        if fingerprint != bytes(agree(np.frombuffer(fingerprint.encode(), np.uint8))).decode():
            raise InputError("all processes must be given the same study, but this one has another; give it that")
        if leads():
            claim(out, command, fingerprint)

    together(check)
    if agree((out / REPORT).exists()):
        console.print(f"nothing to do: {out} holds the results already")
    else:
        try:
            compute()
        except (InputError, SimulationError):
            if leads():
                release(out)
            raise
    if (out / REPORT).exists():
        console.print(f"report: {(out / REPORT).resolve()}")


def run_units(
    job: Job,
    out: pathlib.Path,
    command: str,
    compute: Callable[[Folders], None],
    overview: Callable[[Summaries], str],
) -> Summaries:
    """Runs a command for the units that an earlier run has left; with several, a summary and a report on top.

    **Arguments:** `compute`: writes the `summary.json` of every unit into its folder, and a report where it comes that
    far; `overview`: the report on top.
    """

    def compute_all() -> None:
        left = []
        for unit, folder in unit_folders(job, out):
            if (folder / REPORT).exists():
                console.print(f"{unit.name}: {folder} holds its results")
            else:
                say_notes(trace for _, trace in unit.traces)
                left.append((unit, folder))
        compute(left)
        if job.units[0].name is not None:
            write_json(out / SUMMARY, {"units": summaries()})
            write_text(out / REPORT, overview(summaries()))

    def summaries() -> Summaries:
        return {unit.name: read_json(unit.folder(out) / SUMMARY) for unit in job.units}

    run_once(out, command, job.fingerprint, compute_all)
    return summaries()


def unit_folders(job: Job, out: pathlib.Path) -> Iterator[tuple[Unit, pathlib.Path]]:
    """The units of a job, each with its folder."""
    for unit in job.units:
        folder = unit.folder(out)
        folder.mkdir(exist_ok=True)
        yield unit, folder


class ProgressFile(Generic[P]):
    """Where a computation stands, on disk, so that an interrupted one goes on.

    `progress` is what an earlier run has saved, or `None`; `facts` what it has saved beside.
    """

    def __init__(self, folder: pathlib.Path, kind: type[P], what: str):
        self._path, self._began = folder / PROGRESS, time.monotonic()
        self.progress: P | None = None
        self.facts: dict[str, Any] = {}
        if not self._path.exists():
            return
        try:
            content = read_json(self._path)
            fields = {name: _tuples(value) for name, value in content["progress"].items()}
            progress, seconds = kind(**fields), float(content["seconds"])
        except (InputError, AttributeError, KeyError, TypeError, ValueError):
            console.print(f"note: {self._path} can't be read, so {what} starts again")
            return
        self.progress, self.facts = progress, content.get("facts", {})
        self._began -= seconds
        console.print(f"resuming after step {progress.iteration}")

    @property
    def seconds(self) -> float:
        """Time spent, by earlier runs as well."""
        return time.monotonic() - self._began

    def save(self, progress: P, **facts: Any) -> None:
        """Writes where the computation stands."""
        content = {"seconds": self.seconds, "facts": facts, "progress": dataclasses.asdict(progress)}
        write_json(self._path, content)

    @staticmethod
    def remove_from(folder: pathlib.Path) -> None:
        """Once the results are written."""
        (folder / PROGRESS).unlink(missing_ok=True)


def _tuples(value: Any) -> Any:
    """JSON has lists for tuples, also for those inside of others."""
    if isinstance(value, dict):
        return {name: _tuples(each) for name, each in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
