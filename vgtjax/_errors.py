"""The two ways in which things go wrong: bad input, and a computation that failed."""

from typing import Any

import jax
import jax.core
import numpy as np


class InputError(ValueError):
    """What the user gave breaks a rule; the message is one sentence: rule, value, remedy.

    `argument` is the name of the argument that is at fault, as the function that was called knows it; an application
    that has other names for its input can translate it.
    """

    def __init__(self, message: str, argument: str | None = None):
        super().__init__(message)
        self.argument = argument


class SimulationError(RuntimeError):
    """A simulation failed, so nothing that follows from it may be used; the message says how, and what helps."""


def is_traced(*trees: Any) -> bool:
    """Whether any leaf is being traced by JAX, so that its value is not there to be checked."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def require_positive(name: str, value: Any, what: str, remedy: str) -> None:
    """Refuses what is not positive and finite, e.g. a `number of seconds`; says nothing while it is traced.

    **Raises:** `InputError`.
    """
    if not is_traced(value) and not np.all((np.asarray(value) > 0) & np.isfinite(value)):
        raise InputError(f"{name} must be a positive {what}, but it is {value}; {remedy}")
