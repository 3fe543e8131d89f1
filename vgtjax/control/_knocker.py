"""The knocker: pulses that keep friction from sticking [5.5] (Hagglund, 2002)."""

import equinox as eqx
import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import InputError
from ..parameters import parameter
from ..parts import Scalar
from ._base import AbstractController, Log, Measurement, Memory, Reference


class KnockerState(eqx.Module):
    """Time in s since the latest pulse began, the duty in percent then and when the one before began."""

    controller: Memory
    elapsed: Scalar
    latest: Scalar
    previous: Scalar


class Knocker(AbstractController):
    """Adds pulses to any controller [5.5, corrected: see below].

    `u_k = +alpha sign(u(t) - u(t_p))` for `t_p + t_k <= t < t_p + t_k + tau`, else 0; `t_p` is when the pulse before
    began, so that one begins every `t_k`. The print has the other sign and a pulse that begins at once; its source
    pushes the way the controller moves. Before the first pulse, the duty counts as zero. Times are rounded
    to samples, and a cost has no derivative with respect to them. The sign is that of a difference in duty over itself
    plus `sign_width`, so that it does not jump. The saturation of pulses is not the controller's: its anti-windup does
    not see them.

    **Raises:** `InputError` for a pulse that does not end before the next one begins.
    """

    controller: AbstractController
    amplitude: Scalar = parameter(2.0, symbol="alpha", unit="%", source="5.3.1")
    width: Scalar = parameter(0.02, symbol="tau", unit="s", source="5.3.1", held=True)
    interval: Scalar = parameter(0.04, symbol="t_k", unit="s", source="5.3.1", held=True)
    sign_width: Scalar = parameter(1e-9, symbol="w", unit="%", source="assumed", assumed=True, held=True)

    def __check_init__(self) -> None:
        if isinstance(self.width, jax.core.Tracer) or isinstance(self.interval, jax.core.Tracer):
            return
        if not np.all((np.asarray(self.width) > 0) & (np.asarray(self.width) < np.asarray(self.interval))):
            raise InputError(
                f"a pulse must end before the next one begins, but its width is {self.width} s and the interval "
                f"{self.interval} s; use e.g. 0.02 and 0.04"
            )

    def initial_state(self, measurement: Measurement, period: float) -> KnockerState:
        """As if a pulse had just ended."""
        none = jnp.zeros_like(measurement.position)
        return KnockerState(self.controller.initial_state(measurement, period), none + self.width, none, none)

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
        return (
            KnockerState(memory, elapsed + period, latest, previous),
            command + pulse,
            {**log, "pulse": pulse},
        )
