"""Units of a study side by side in several processes: for work that keeps Python busy as well as programs."""

import contextlib
import io
import multiprocessing
import os
import pathlib
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.queues import SimpleQueue

from vgtjax import SimulationError

from .memory import available_memory
from .output.console import console
from .resumable import Folders
from .study.units import Job, Unit
from .temporary import temporary_folder

Work = Callable[[Job, Unit, pathlib.Path], None]

POLL = 0.05
"""s between two looks at what processes have said."""
NEEDED = 2 * 2**30
"""Bytes of memory that a process with a unit may need: a fit takes 1 to 2 GB."""

_JOB: Job


def each_unit(job: Job, folders: Folders, work: Work) -> None:
    """Does some work for every unit, which says what it does on the console; a study of one unit needs no process.

    A unit's results don't depend on how many are left, or run at a time.

    **Raises:** whatever the work raises, after nothing new was begun.
    """
    if len(job.units) == 1:
        for unit, folder in folders:
            work(job, unit, folder)
        return
    import jax

    if not folders:
        return
    cache: str | None = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    cores = jax.local_device_count(backend="cpu")
    processes = _processes(len(folders), cores)
    devices = max(1, cores // len(job.units))
    context = multiprocessing.get_context("spawn")  # JAX does not survive a fork
    # By a file: what a process is begun with goes through a pipe, whose writer waits for ever if that is more than the
    # pipe holds and the process dies before it has read it.
    with temporary_folder() as temporary:
        written = temporary / "job"
        written.write_bytes(pickle.dumps(job))
        said: SimpleQueue[str] = context.SimpleQueue()
        pool = ProcessPoolExecutor(processes, context, _begin, (written, cache, devices, said))
        with pool, console.status(f"{len(folders)} units, {processes} at a time"), _listening(said):
            _gather(pool, [pool.submit(_do, work, _number(job, unit), folder) for unit, folder in folders])


def _processes(units: int, cores: int) -> int:
    """How many processes run at a time, of as many as units and cores allow: those that memory has room for."""
    wanted, left = min(units, cores), available_memory()
    processes = max(1, min(wanted, left // NEEDED))
    if processes < wanted:
        console.print(
            f"note: {processes} of {wanted} processes run at a time, as each may need {NEEDED / 2**30:g} GiB of memory "
            f"and {left / 2**30:.1f} are left"
        )
    return processes


def _gather(pool: ProcessPoolExecutor, futures: Sequence[Future[None]]) -> None:
    """Waits for all; nothing new is begun after trouble."""
    try:
        for future in as_completed(futures):
            future.result()
    except BrokenProcessPool as error:
        raise SimulationError(
            "a process of this run was ended, for want of memory for instance; run the same command again, and it goes "
            "on"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _listening(said: "SimpleQueue[str]") -> Generator[None]:
    """Says what the processes say, as they do."""
    over = threading.Event()

    def listen() -> None:
        while not (said.empty() and over.is_set()):
            if said.empty():
                over.wait(POLL)
            else:
                console.print(said.get(), end="")

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        yield
    finally:
        over.set()
        listener.join(1.0)  # one that was ended within a word never ends it


class _Told(io.TextIOBase):
    """Standard output of a process that tells another what it says, line by line."""

    def __init__(self, said: "SimpleQueue[str]") -> None:
        self._said, self._begun = said, ""

    def write(self, text: str, /) -> int:
        whole, end, self._begun = (self._begun + text).rpartition("\n")
        if end:
            self._said.put(whole + end)
        return len(text)


def _number(job: Job, unit: Unit) -> int:
    return next(number for number, each in enumerate(job.units) if each is unit)


def _begin(job: pathlib.Path, cache: str | None, devices: int, said: "SimpleQueue[str]") -> None:
    """A process with so many cores of its own, which ends with the one that began it."""
    from vgtjax import configure

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a whole group of processes, the first one says it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    sys.stdout = _Told(said)

    global _JOB
    configure(cpu_devices=devices, cache=cache)
    _JOB = pickle.loads(job.read_bytes())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker was begun by another process"
    parent.join()
    os._exit(1)


def _do(work: Work, number: int, folder: pathlib.Path) -> None:
    work(_JOB, _JOB.units[number], folder)
