"""The knocker: pulses that keep friction from sticking [5.5] (Hagglund, 2002)."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference
from .._design import Condition, positive
from ._pid import PI


class KnockerState(eqx.Module):
    """Time in s since the latest pulse began, the duty in percent then and when the one before began."""

    controller: Memory
    elapsed: Scalar
    latest: Scalar
    previous: Scalar


class Knocker(AbstractController):
    """Adds pulses to any controller [5.5, corrected; see the manual's page of derivations].

    `u_k = +alpha sign(u(t) - u(t_p))` for `t_p + t_k <= t < t_p + t_k + tau`, else 0; `t_p` is when the pulse before
    began, so that one begins every `t_k`. The sign is that of a difference in duty over itself plus `sign_width`, so
    that it does not jump.

    **Raises:** `InputError` for a pulse that does not end before the next one begins.
    """

    controller: AbstractController
    amplitude: Scalar = parameter(2.0, symbol="alpha", unit="%", source="5.3.1")
    width: Scalar = parameter(0.02, symbol="tau", unit="s", source="5.3.1", held=True)
    interval: Scalar = parameter(0.04, symbol="t_k", unit="s", source="5.3.1", held=True)
    # Tuned at a tenth of a usual pulse.
    sign_width: Scalar = parameter(1e-9, symbol="w", unit="%", source="assumed", held=True, above=0.0, tuning_width=0.2)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "Knocker":
        """Around the [`PI`][] for the plant."""
        return cls(**{"controller": PI.for_plant(plant)} | settings)

    @property
    def sees_gaps(self) -> bool:
        """As the controller inside."""
        return self.controller.sees_gaps

    def conditions(self) -> dict[str, Condition]:
        """A pulse ends before the next one begins."""
        return positive(self, "width") | {
            "width below interval [5.5]": Condition(
                1 - self.width / self.interval,
                "width must be below the interval of {limit} s, so that a pulse ends before the next one begins",
                self.width,
                "use e.g. 0.02 and 0.04",
                self.interval,
            )
        }

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return self.controller.observes

    def initial_state(self, measurement: Measurement) -> KnockerState:
        """As if a pulse had just ended."""
        none = jnp.zeros_like(measurement.position)
        return KnockerState(self.controller.initial_state(measurement), none + self.width, none, none)

    def update(
        self, state: KnockerState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[KnockerState, Scalar, Log]:
        """See the base class; logs the `pulse` in percent."""
        memory, command, log = self.controller.update(state.controller, measurement, reference, period)
        # Sums of the period miss a time by rounding, never by half a period.
        begins = state.elapsed > self.interval - 0.5 * period
        elapsed = jnp.where(begins, 0.0, state.elapsed)
        latest = jnp.where(begins, command, state.latest)
        previous = jnp.where(begins, state.latest, state.previous)
        moved = command - previous
        push = self.amplitude * moved / (jnp.abs(moved) + self.sign_width)
        pulse = jnp.where(elapsed < self.width - 0.5 * period, push, 0.0)
        return KnockerState(memory, elapsed + period, latest, previous), command + pulse, {**log, "pulse": pulse}
