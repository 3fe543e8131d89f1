"""Many samples through the experiments, chunk by chunk: resumable, in bounded memory, with progress."""

import dataclasses
import pathlib
import shutil
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import rich.progress

from vgtjax import InputError
from vgtjax.experiments import Output
from vgtjax.population import Evaluator, Sample

from ..output.console import console
from ..output.files import REPORT, claim
from ..resumable import is_done, say_report
from .chunks import FOLDER, ChunkStore
from .job import PopulationJob
from .processes import agree, leads, meet, together

T = TypeVar("T")


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """Which samples go through which experiments, and what is kept of them.

    `outputs` are stored, curves among them of the first `curves` samples; `lanes` samples are simulated and stored at
    a time.
    """

    job: PopulationJob
    evaluator: Evaluator
    sample: Sample
    outputs: tuple[Output, ...]
    curves: int
    lanes: int


def carry_out(
    plan: Plan,
    out: pathlib.Path,
    command: str,
    derive: Callable[[], T],
    write: Callable[[ChunkStore, T, float], None],
) -> None:
    """Simulates what is missing in `out`, then writes the results; does nothing where they are already.

    **Arguments:** `derive`: simulates what is wanted beside the samples, in all processes; `write`: makes the files
    of the samples, of that, and of the seconds that all took, in the first process.
    """
    if not claim_together(out, command, plan.job.fingerprint):
        return
    for note in plan.job.notes:
        console.print(f"note: {note}")
    began = time.monotonic()
    store = ChunkStore(out, plan.outputs, plan.sample.rows, plan.lanes, plan.curves)
    _sweep(plan, store, command)
    derived = derive()
    if leads():
        write(store, derived, time.monotonic() - began)
        store.remove()
        say_report(out)
    meet()


def _sweep(plan: Plan, store: ChunkStore, title: str) -> None:
    """Computes the chunks that are missing in the store.

    Which sample a row is depends on its number alone, so neither chunks nor devices nor processes change it.
    """
    missing = np.flatnonzero(agree(store.missing())).tolist()
    if len(missing) < store.count:
        console.print(f"resuming with {store.count - len(missing)} of {store.count} chunks done")
    with _progress() as progress:
        sizes = {number: store.span(number)[1] - store.span(number)[0] for number in missing}
        task = progress.add_task(title, total=store.rows, completed=store.rows - sum(sizes.values()))
        for number, size in sizes.items():
            results = plan.evaluator(plan.job.population.values(plan.sample.points(*store.span(number))))
            if leads():
                store.save(number, results)
            progress.update(task, advance=size)


def claim_together(out: pathlib.Path, command: str, fingerprint: str) -> bool:
    """Makes `out` the folder of this command and study; false where it holds the finished results already."""

    def check() -> None:
        if fingerprint != bytes(agree(np.frombuffer(fingerprint.encode(), np.uint8))).decode():
            raise InputError("all processes must be given the same study, but this one has another; give it that")
        if leads():
            claim(out, command, fingerprint)

    together(check)
    finished = bool(agree((out / REPORT).exists()))
    if finished and leads():
        shutil.rmtree(out / FOLDER, ignore_errors=True)  # left by a run that was killed after its report
        is_done(out)
    return not finished


def _progress() -> rich.progress.Progress:
    return rich.progress.Progress(
        rich.progress.TextColumn("{task.description}"),
        rich.progress.BarColumn(),
        rich.progress.MofNCompleteColumn(),
        rich.progress.TimeElapsedColumn(),
        rich.progress.TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not leads(),
    )
