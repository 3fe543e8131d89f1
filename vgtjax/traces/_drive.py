"""What acts on a model from outside: a duty held or linear between samples, and pressures linear between them."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from .._types import Values

Flags = Bool[Array, "..."] | Bool[np.ndarray, "..."]
Count = Int[Array, ""] | Int[np.ndarray, ""] | int


class Ramp(eqx.Module):
    """A signal that is linear over an interval: value at its start, and rate per second."""

    start: Values
    rate: Values

    def __call__(self, elapsed: Values) -> Values:
        """Value `elapsed` seconds after the start of the interval."""
        return self.start + self.rate * elapsed


class Knot(eqx.Module):
    """Where a duty jumps or changes its rate inside an interval, once."""

    jump: Values
    """How far it jumps there, in percent."""
    bend: Values
    """How its rate changes there, in percent per second."""
    place: Values
    """The part of the interval that has passed by then; zero where there is none."""

    def begin(self, number: Count, count: Count) -> Values:
        """The part of the interval that has passed when a step begins, of `count` equal ones of which the knot cuts one
        in two; continuous in `place`, with the derivative of a later one."""
        passed = self.place * count
        return jnp.where(
            passed < number - 1, (number - 1) / count, jnp.where(passed < number, self.place, number / count)
        )


class Drive(eqx.Module):
    """Inputs over one interval between two samples, or over all intervals of a trace (leading axis).

    Nothing but a late duty has a knot inside an interval, and its time counts from its own start, so that single
    precision does not lose it. A signal that a trace does not have is `None`.
    """

    duration: Values
    """Length in s; zero marks padding, over which no state moves."""
    ambient_shift: Values
    """How far the trace's atmosphere lies above the standard 101013 Pa, in Pa."""
    turbine: Ramp
    """Turbine inlet pressure in Pa gauge."""
    pwm: Values | None = None
    """Duty in percent where it begins. A model sees it held over a step at what it is half-way."""
    pwm_rate: Values | None = None
    """Its rate in percent per second; zero or `None` where it is held."""
    reservoir: Ramp | None = None
    """Reservoir pressure in Pa absolute."""
    chamber: Ramp | None = None
    """Measured chamber pressure in Pa absolute, the input of the mechanical model."""
    force: Ramp | None = None
    """Measured drive along +x in N, which replaces the chamber pressure as input of the mechanical model."""
    position: Ramp | None = None
    """Given position of the diaphragm in m, the input of the pneumatic model."""
    knot: Knot | None = None
    """Of a duty that is late; `pwm` and `pwm_rate` are those before."""

    @property
    def duty(self) -> tuple[Values | None, ...]:
        """What a delay of the duty moves."""
        return (self.pwm,) if self.knot is None else (self.pwm, self.knot.place)

    def with_duty(self, duty: tuple[Values | None, ...]) -> "Drive":
        """The same inputs with another `duty`."""
        pwm, *place = duty
        knot = None if self.knot is None else dataclasses.replace(self.knot, place=place[0])
        return dataclasses.replace(self, pwm=pwm, knot=knot)

    def steps(self, count: Count) -> Count:
        """How many steps go over the interval instead of `count` equal ones: none straddles a knot of the duty."""
        return count if self.knot is None else count + 1

    def step(self, number: Count, count: Count) -> tuple[Values, Values, "Drive"]:
        """Begin and end in s of one of these steps, and the inputs during it."""
        if self.knot is None:
            size = self.duration / count
            begin = jnp.asarray(number, size.dtype) * size
            return begin, begin + size, self.held_at(begin + 0.5 * size)
        begin, end = (self.duration * self.knot.begin(each, count) for each in (number, number + 1))
        inputs = self.held_at(0.5 * (begin + end))
        assert inputs.pwm is not None, "only a duty has a knot"
        since = 0.5 * (begin + end) - self.duration * self.knot.place
        moved = jnp.where(number > self.knot.place * count, self.knot.jump + self.knot.bend * since, 0.0)
        return begin, end, dataclasses.replace(inputs, pwm=inputs.pwm + moved)

    def held_at(self, elapsed: Values) -> "Drive":
        """The same inputs with the duty held at what it is `elapsed` s after the start, before a knot."""
        if self.pwm is None or self.pwm_rate is None:
            return self
        return dataclasses.replace(self, pwm=self.pwm + self.pwm_rate * elapsed)


class Start(eqx.Module):
    """What a trace says about the state at its first sample; unknown values are zero."""

    at_rest: Flags
    """Whether the first duty is zero and the chamber at atmosphere."""
    pressure: Values
    """Mean chamber pressure of the first 50 ms in Pa absolute."""
    pressure_known: Flags
    position: Values
    """Mean position of the first 50 ms in m."""
    position_known: Flags
    number: Int[Array, "..."] | Int[np.ndarray, "..."] = eqx.field(default_factory=lambda: np.asarray(0))
    """Which of the start states that a fit frees is its own; zero for none."""

    def chamber_pressure(self, ambient: Values, balanced: Values, working: Values) -> Values:
        """Chamber pressure at the first sample in Pa absolute: ambient at rest, or else the first that is known.

        **Arguments:** pressures in Pa absolute: of the air; in balance with the position, which counts where that is
        known; and the converter's working pressure at the first duty.
        """
        unknown = jnp.where(self.position_known, balanced, working)
        pressure = jnp.where(self.pressure_known, self.pressure, unknown)
        return jnp.where(self.at_rest, ambient, pressure)
