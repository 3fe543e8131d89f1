"""Units of a study side by side, each in a process of its own: for work that one core is busy with, but no program."""

import multiprocessing
import os
import pathlib
import pickle
import signal
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from vgtjax import SimulationError

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
    # By a file: what a process is begun with goes through a pipe, whose writer waits for ever if that is more than the
    # pipe holds and the process dies before it has read it.
    with tempfile.TemporaryDirectory() as temporary:
        written = pathlib.Path(temporary) / "job"
        written.write_bytes(pickle.dumps(job))
        pool = ProcessPoolExecutor(processes, context, _begin, (written, cache))
        with pool, console.status(f"{len(folders)} units, {processes} at a time"):
            _gather(pool, [pool.submit(_do, work, _number(job, unit), folder) for unit, folder in folders])


def _gather(pool: ProcessPoolExecutor, futures: Sequence[Future[str]]) -> None:
    """Says what each has said, as they come; nothing new is begun after trouble."""
    try:
        for future in as_completed(futures):
            console.print(future.result(), end="")
    except BrokenProcessPool as error:
        raise SimulationError(
            "a process of this run was ended, for want of memory for instance; run the same command again, and it goes "
            "on"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


def _number(job: Job, unit: Unit) -> int:
    return next(number for number, each in enumerate(job.units) if each is unit)


def _begin(job: pathlib.Path, cache: str | None) -> None:
    """A process with one core of its own, which ends with the one that began it."""
    from vgtjax import configure

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a whole group of processes, the first one says it
    threading.Thread(target=_end_with_parent, daemon=True).start()

    global _JOB
    configure(cpu_devices=1, cache=cache)
    _JOB = pickle.loads(job.read_bytes())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker was begun by another process"
    parent.join()
    os._exit(1)


def _do(work: Work, number: int, folder: pathlib.Path) -> str:
    with console.capture() as said:
        work(_JOB, _JOB.units[number], folder)
    return said.get()
