"""Many samples through the experiments, chunk by chunk: resumable, in bounded memory, with progress."""

import dataclasses
import pathlib
import shutil
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import rich.progress

from vgtjax.experiments import Output
from vgtjax.population import Evaluator, Sample

from ..output.console import console
from ..processes import agree, leads, meet
from ..resumable import run_once
from .chunks import FOLDER, ChunkStore
from .job import PopulationJob

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
    derive: Callable[[ChunkStore], T],
    write: Callable[[ChunkStore, T, float], None],
) -> None:
    """Simulates what is missing in `out`, then writes the results; does nothing where they are already.

    **Arguments:** `derive`: simulates what is wanted beside the samples, which are in the store, in all processes;
    `write`: makes the files of the samples, of that, and of the seconds that all took, in the first process.
    """

    def compute() -> None:
        for note in plan.job.notes:
            console.print(f"note: {note}")
        began = time.monotonic()
        store = ChunkStore(out, plan.outputs, plan.sample.rows, plan.lanes, plan.curves)
        _sweep(plan, store, command)
        derived = derive(store)
        if leads():
            write(store, derived, time.monotonic() - began)

    run_once(out, command, plan.job.fingerprint, compute)
    if leads():
        shutil.rmtree(out / FOLDER, ignore_errors=True)  # also what a run has left that was killed after its report
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
