"""A command that runs in several processes at once: all compute, the first one talks and writes."""

from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils

from vgtjax.errors import InputError

from ..console import console


def join(coordinator: str | None, count: int | None, index: int | None) -> None:
    """Joins the other processes, before JAX computes anything; does nothing where no coordinator is named.

    **Raises:** `InputError` when only some of the three are given, or they contradict each other.
    """
    given = (coordinator, count, index)
    if all(option is None for option in given):
        return
    if coordinator is None or count is None or index is None:
        raise InputError(
            "--coordinator, --processes and --process belong together, but some are missing; give all three"
        )
    if not 0 <= index < count:
        raise InputError(f"--process must count from 0 to {count - 1}, but it is {index}; correct it")
    jax.distributed.initialize(coordinator, count, index)
    console.quiet = index > 0


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
