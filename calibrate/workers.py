"""Units of a study side by side, each in a process of its own: for work that one core is busy with, but no program."""

import multiprocessing
import pathlib
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed

from .output.console import console
from .resumable import Folders
from .study.units import Job, Unit

Work = Callable[[Job, Unit, pathlib.Path], None]

_JOB: Job


def each_unit(job: Job, folders: Folders, work: Work) -> None:
    """Does some work for every unit, which says what it does on the console; a study of one unit needs no process.

    A unit's results don't depend on how many are left, and what it says comes when it is done.

    **Raises:** whatever the work raises, after nothing new was begun.
    """
    if len(job.units) == 1:
        for unit, folder in folders:
            work(job, unit, folder)
        return
    import jax

    cache: str | None = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    processes = min(len(folders), jax.local_device_count(backend="cpu"))
    if not processes:
        return
    context = multiprocessing.get_context("spawn")  # JAX does not survive a fork
    with (
        ProcessPoolExecutor(processes, context, _begin, (pickle.dumps(job), cache)) as pool,
        console.status(f"{len(folders)} units, {processes} at a time"),
    ):
        futures = [pool.submit(_do, work, _number(job, unit), folder) for unit, folder in folders]
        try:
            for future in as_completed(futures):
                console.print(future.result(), end="")
        finally:
            pool.shutdown(cancel_futures=True)


def _number(job: Job, unit: Unit) -> int:
    return next(number for number, each in enumerate(job.units) if each is unit)


def _begin(job: bytes, cache: str | None) -> None:
    """A process with one core of its own."""
    from vgtjax import configure

    global _JOB
    configure(cpu_devices=1, cache=cache)
    _JOB = pickle.loads(job)


def _do(work: Work, number: int, folder: pathlib.Path) -> str:
    with console.capture() as said:
        work(_JOB, _JOB.units[number], folder)
    return said.get()
