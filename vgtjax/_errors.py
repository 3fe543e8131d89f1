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
    if not is_traced(value):
        numbers = np.asarray(value, float)
        _require((numbers > 0) & np.isfinite(numbers), f"{name} must be a positive {what}", value, remedy)


def require_finite(name: str, value: Any, what: str, remedy: str) -> None:
    """Refuses what is not finite, e.g. a `tangent of an angle`; says nothing while it is traced.

    **Raises:** `InputError`.
    """
    if not is_traced(value):
        _require(np.isfinite(np.asarray(value, float)), f"{name} must be a finite {what}", value, remedy)


def _require(good: Any, rule: str, value: Any, remedy: str) -> None:
    """Names a value that breaks a rule: the only one, or the first of many."""
    if not np.all(good):
        wrong = value if np.ndim(value) == 0 else np.asarray(value, float)[~good][0]
        raise InputError(f"{rule}, but it is {wrong}; {remedy}")
