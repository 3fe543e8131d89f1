"""A command that runs in several processes at once: all compute, the first one talks and writes."""

import contextlib
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import jax
import numpy as np
from jax.experimental import multihost_utils

from vgtjax import InputError, SimulationError

from .output.console import console

T = TypeVar("T")
EXCHANGE = ("Gloo", "NCCL", "UNAVAILABLE")
"""One of them is in JAX's error where an exchange between processes failed; any other is this process's own trouble."""


def join(coordinator: str | None, count: int | None, index: int | None) -> None:
    """Joins the other processes, before JAX computes anything; does nothing where no coordinator is named."""
    given = (coordinator, count, index)
    if all(option is None for option in given):
        return
    if coordinator is None or count is None or index is None:
        raise InputError(
            "--coordinator, --processes and --process belong together, but some are missing; give all three"
        )
    if count < 1:
        raise InputError(f"--processes must be one or more, but it is {count}; correct it")
    if not 0 <= index < count:
        raise InputError(f"--process must count from 0 to {count - 1}, but it is {index}; correct it")
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"--coordinator must be HOST:PORT, but it is '{coordinator}'; write e.g. localhost:12345")
    try:
        jax.distributed.initialize(coordinator, count, index)
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"the processes could not meet at {coordinator} ({reason}); choose a free port") from error
    console.quiet = index > 0


@contextlib.contextmanager
def bereaved() -> Iterator[None]:
    """Ends this process, with one sentence and exit status 1, where another one of the run has died.

    The next exchange with it fails, at once where a connection broke. Then at once, as JAX's own farewell waits minutes
    for the dead. What nobody foresaw ends it at once too, with its traceback, so that the others notice.
    """
    try:
        yield
    except (InputError, SimulationError, OSError):
        raise
    except Exception as error:
        if jax.process_count() == 1:
            raise
        if isinstance(error, jax.errors.JaxRuntimeError) and any(word in str(error) for word in EXCHANGE):
            end = "failed: another process of this run has died; start all of them again, and they go on\n"
        else:
            end = traceback.format_exc()
        sys.stdout.flush()
        os.write(2, end.encode())
        os._exit(1)


def together(prepare: Callable[[], T]) -> T:
    """What `prepare` returns, in every process, if it refuses in none.

    **Raises:** `InputError` of this process, or one that says that another has refused.
    """
    try:
        found, trouble = prepare(), None
    except InputError as error:
        found, trouble = None, error
    refused = trouble is not None
    if jax.process_count() > 1:
        refused = bool(np.any(multihost_utils.process_allgather(np.asarray(refused))))
    if refused:
        raise trouble or InputError("another process refused its input; its message says why, and this one stops too")
    return cast(T, found)


def leads() -> bool:
    """Whether this process is the one that writes."""
    return jax.process_index() == 0


def agree(value: Any) -> np.ndarray:
    """The first process's value, in all of them."""
    if jax.process_count() == 1:
        return np.asarray(value)
    return np.asarray(multihost_utils.broadcast_one_to_all(np.asarray(value)))


def meet() -> None:
    """Waits for the other processes."""
    if jax.process_count() > 1:
        multihost_utils.sync_global_devices("meet")
