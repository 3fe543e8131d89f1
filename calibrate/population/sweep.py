"""Many samples through the experiments, chunk by chunk: resumable, in bounded memory, with progress."""

import pathlib
import shutil
from collections.abc import Sequence

import numpy as np
import rich.progress

from vgtjax import InputError
from vgtjax.population import Evaluator, Population
from vgtjax.sensitivity import Sample

from ..output.console import console
from ..output.files import claim
from .chunks import FOLDER, ChunkStore
from .processes import agree, leads, together


def sweep(
    evaluator: Evaluator, population: Population, sample: Sample, store: ChunkStore, keep: Sequence[int], title: str
) -> None:
    """Computes the chunks that are missing in the store.

    Which sample a row is depends on its number alone, so neither chunks nor devices nor processes change it.

    **Arguments:** `keep`: which of the evaluator's columns are stored.
    """
    missing = np.flatnonzero(agree(store.missing())).tolist()
    if len(missing) < store.count:
        console.print(f"resuming with {store.count - len(missing)} of {store.count} chunks done")
    with _progress() as progress:
        done = store.rows - sum(store.size(number) for number in missing)
        task = progress.add_task(title, total=store.rows, completed=done)
        for number in missing:
            begin, end = store.span(number)
            results = evaluator(population.values(sample.points(begin, end)))
            if leads():
                store.save(number, results.only(keep))
            progress.update(task, advance=end - begin)


def claim_together(out: pathlib.Path, command: str, fingerprint: str) -> bool:
    """Makes `out` the folder of this command and study; false where it holds the finished results already.

    **Raises:** `InputError` when it can't be.
    """

    def check() -> None:
        if fingerprint != bytes(agree(np.frombuffer(fingerprint.encode(), np.uint8))).decode():
            raise InputError("all processes must be given the same study, but this one has another; give it that")
        if leads():
            claim(out, command, fingerprint)

    together(check)
    finished = bool(agree((out / "report.html").exists()))
    if finished and leads():
        shutil.rmtree(out / FOLDER, ignore_errors=True)  # left by a run that was killed after its report
        console.print(f"nothing to do: {out} holds this study's results")
        console.print(f"report: {(out / 'report.html').resolve()}")
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
