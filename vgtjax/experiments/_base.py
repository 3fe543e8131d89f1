"""What a bench test is to a study: which traces drive the actuator, and which numbers are read off its response."""

import abc
import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import Scalar, Values
from ..traces import Drive, Start, Trace

LONGEST = 3600.0
"""s; a run that is longer is a mistake, not an experiment."""

Readings = dict[str, Values]


@dataclasses.dataclass(frozen=True)
class Output:
    """What one entry of an experiment's readings is: a number, or a curve over `axis`.

    `unit` is `Pa`, `s` or `m`; `meaning` is a short phrase. `axis` holds the places at which a curve is read, in
    `axis_unit`; it is empty for a number.
    """

    name: str
    unit: str
    meaning: str
    axis: tuple[float, ...] = ()
    axis_unit: str = ""

    @property
    def size(self) -> int:
        """Numbers that the entry holds."""
        return max(1, len(self.axis))


class AbstractExperiment(eqx.Module):
    """A bench test in simulation: inputs, and a differentiable reading of the response.

    All of its traces have the same sample times, so that one compiled march serves them.
    """

    @property
    @abc.abstractmethod
    def traces(self) -> tuple[Trace, ...]:
        """The runs of the test, at equal sample times."""

    @property
    @abc.abstractmethod
    def outputs(self) -> tuple[Output, ...]:
        """What `read` returns, in its order."""

    @abc.abstractmethod
    def read(self, x_d: Float[Array, "runs time"], p_act: Float[Array, "runs time"], ambient: Scalar) -> Readings:
        """The readings by name; NaN where the response does not have them.

        **Arguments:** position in m and chamber pressure in Pa absolute of every run, ambient pressure in Pa.
        """


def stack_runs(traces: tuple[Trace, ...]) -> tuple[Drive, Start]:
    """Inputs and starts of traces at equal sample times, with a leading axis of runs."""
    drives, starts = [trace.drive() for trace in traces], [trace.start() for trace in traces]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *drives), jax.tree.map(
        lambda *leaves: np.stack(leaves), *starts
    )


def first_reach(x: Float[Array, " time"], y: Float[Array, " time"], level: Values) -> Values:
    """Value of `y` where `x` first reaches `level`, linear between samples; NaN where it begins beyond or never does.

    Differentiable by both signals and by the level.
    """
    highest = jax.lax.cummax(x)
    after = jnp.searchsorted(highest, level)
    found = (after > 0) & (after < len(x))
    safe = jnp.clip(after, 1, len(x) - 1)
    low, high = x[safe - 1], x[safe]
    # Where nothing is found the two samples may be equal, and the division must stay finite for the gradient.
    weight = (level - low) / jnp.where(found, high - low, 1.0)
    return jnp.where(found, y[safe - 1] + jnp.where(found, weight, 0.0) * (y[safe] - y[safe - 1]), jnp.nan)
