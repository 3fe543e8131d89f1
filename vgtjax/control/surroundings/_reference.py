"""Signals over time: references with three derivatives, and pressures around the actuator."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Float

from ..._errors import InputError, is_traced, require_positive
from ..._types import Scalar
from ...parameters import as_float_array
from .._base import Reference

ORDER = 5
"""Degree of the spline through samples: its third derivative is smooth."""
SIGNAL_1_RATE = 0.125
"""rad/s [5.44]"""
SIGNAL_1_PERIOD = 2 * np.pi / SIGNAL_1_RATE
"""s"""
SECONDS = ("number of seconds", "use e.g. 0.1")
"""What errors say of a time that is none."""


def number(**settings: Any) -> Any:
    """A field that holds floating numbers, an array leaf that is no parameter of a table."""
    return eqx.field(converter=as_float_array, **settings)


class AbstractSignal(eqx.Module):
    """A function of time with array leaves, so that scenarios that differ in them can be batched."""

    @abc.abstractmethod
    def __call__(self, time: Scalar) -> Scalar:
        """Value at `time` in s."""


def reference_at(signal: AbstractSignal, time: Scalar) -> Reference:
    """A signal in m with its first three derivatives at `time` in s, by automatic differentiation."""

    def derivative(function):
        return lambda t: jax.jvp(function, (t,), (jnp.ones_like(t),))[1]

    velocity = derivative(signal)
    acceleration = derivative(velocity)
    return Reference(signal(time), velocity(time), acceleration(time), derivative(acceleration)(time))


class Constant(AbstractSignal):
    """The same value at all times."""

    level: Scalar = number()

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        return jnp.broadcast_to(self.level, jnp.shape(time))


class Sine(AbstractSignal):
    """`offset + amplitude sin(rate t + phase)`, `rate` in rad/s and `phase` in rad."""

    amplitude: Scalar = number()
    rate: Scalar = number()
    offset: Scalar = number(default=0.0)
    phase: Scalar = number(default=0.0)

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        return self.offset + self.amplitude * jnp.sin(self.rate * time + self.phase)


class Steps(AbstractSignal):
    """Goes from `initial` to `levels` at `times`, each step within `rise` seconds.

    Each step is the polynomial of degree seven whose first three derivatives vanish at both ends, so that the jerk is
    continuous; it begins at its time. Steps may overlap. A `rise` below the sampling time is a jump whose derivatives
    no sample sees.

    **Arguments:** `times` in s and `levels`, both of shape `(steps,)`.

    **Raises:** `InputError` for shapes that differ, or a `rise` that is not positive.
    """

    times: Float[Array | np.ndarray, " steps"] = number()
    levels: Float[Array | np.ndarray, " steps"] = number()
    initial: Scalar = number(default=0.0)
    rise: Scalar = number(default=0.1)

    def __check_init__(self) -> None:
        _require_equal_length(self.times, self.levels)
        require_positive("rise", self.rise, *SECONDS)

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        before = jnp.concatenate([self.initial[None], self.levels[:-1]])
        return self.initial + jnp.sum((self.levels - before) * _smooth_step((time - self.times) / self.rise))


class Ramps(AbstractSignal):
    """Straight lines through `levels` at `times`, held before and after, with corners rounded over `rounding` seconds.

    The slope changes along the same polynomial as a step of [`Steps`][], centred on the corner; half of `rounding`
    away from every corner the lines are exact.

    **Arguments:** `times` in s and `levels`, both of shape `(corners,)`.

    **Raises:** `InputError` for shapes that differ, times that don't increase, or a `rounding` that is not positive.
    """

    times: Float[Array | np.ndarray, " corners"] = number()
    levels: Float[Array | np.ndarray, " corners"] = number()
    rounding: Scalar = number(default=0.1)

    def __check_init__(self) -> None:
        _require_equal_length(self.times, self.levels)
        if not np.size(self.times):
            raise InputError("ramps need a corner at least, but there is none; give a time and a level")
        if not is_traced(self.times) and not np.all(np.diff(self.times) > 0):
            raise InputError(f"times of corners must increase, but they are {self.times}; sort them with their levels")
        require_positive("rounding", self.rounding, *SECONDS)

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        slopes = jnp.diff(self.levels) / jnp.diff(self.times)
        level_ends = jnp.zeros_like(self.levels[:1])
        bends = jnp.diff(jnp.concatenate([level_ends, slopes, level_ends]))
        since = (time - self.times) / self.rounding + 0.5
        return self.levels[0] + self.rounding * jnp.sum(bends * _smooth_ramp(since))


class FadeIn(AbstractSignal):
    """A signal multiplied by a smooth step from zero to one, which begins `at` and takes `rise` seconds."""

    signal: AbstractSignal
    at: Scalar = number(default=0.0)
    rise: Scalar = number(default=1.0)

    def __check_init__(self) -> None:
        require_positive("rise", self.rise, *SECONDS)

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        return self.signal(time) * _smooth_step((time - self.at) / self.rise)


class Later(AbstractSignal):
    """A signal from `begin` seconds of its own time on."""

    signal: AbstractSignal
    begin: Scalar = number()

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        return self.signal(time + self.begin)


class Sampled(AbstractSignal):
    """A spline of degree five, held before its first sample and after its last. Make it with `through`."""

    starts: Float[Array, " intervals"] = number()
    """s; where each polynomial begins."""
    coefficients: Float[Array, "degree intervals"] = number()
    """Of each polynomial, highest power first."""
    end: Scalar = number()
    """s; the last sample."""

    @classmethod
    def through(cls, time: Float[np.ndarray, " time"], values: Float[np.ndarray, " time"]) -> "Sampled":
        """The spline through samples, for instance a column of a trace.

        It overshoots where samples jump: use [`Steps`][] there.

        **Raises:** `InputError` for fewer than six samples, or times that do not increase.
        """
        time, values = np.asarray(time, float), np.asarray(values, float)
        if time.shape != values.shape or len(time) <= ORDER or not np.all(np.diff(time) > 0):
            raise InputError(
                f"a sampled signal needs at least {ORDER + 1} values at increasing times, but there are {values.shape} "
                f"values at {time.shape} times; give more samples, sort them, and remove repeated ones"
            )
        pieces = scipy.interpolate.PPoly.from_spline(scipy.interpolate.make_interp_spline(time, values, k=ORDER))
        # The spline's outermost knots are repeated.
        real = np.diff(pieces.x) > 0
        return cls(pieces.x[:-1][real], pieces.c[:, real], time[-1])

    def __call__(self, time: Scalar) -> Scalar:
        """See the base class."""
        # At a tie a clip would halve the derivatives.
        time = jnp.where(time < self.starts[0], self.starts[0], jnp.where(time > self.end, self.end, time))
        index = jnp.clip(jnp.searchsorted(self.starts, time, side="right") - 1, 0)
        return jnp.polyval(self.coefficients[:, index], time - self.starts[index])


def signal_1(rise: float = 1.0) -> AbstractSignal:
    """Signal 1 [5.44]: `0.005 sin(0.125 t) + 0.005` in m.

    The printed one begins at 5 mm, where a rod at rest is not: here it grows from zero over `rise` seconds, and is as
    printed afterwards.
    """
    return FadeIn(Sine(amplitude=0.005, rate=SIGNAL_1_RATE, offset=0.005), rise=rise)


def signal_2(rise: float = 0.5) -> AbstractSignal:
    """Signal 2 [5.45]: from 0 to 8 mm at 3 s.

    The print does not say what stands for the derivatives of its jump: here the step takes `rise` seconds, by default
    the response time that the thesis reports; with `rise` below the sampling time it is as printed.
    """
    return Steps(times=jnp.asarray([3.0]), levels=jnp.asarray([0.008]), rise=rise)


def _smooth_step(share: Array) -> Array:
    """From zero to one while `share` does, with three derivatives that vanish at both ends."""
    s = jnp.clip(share, 0.0, 1.0)
    return s**4 * (35 + s * (-84 + s * (70 - 20 * s)))


def _smooth_ramp(share: Array) -> Array:
    """Integral of the smooth step."""
    s = jnp.clip(share, 0.0, 1.0)
    return s**5 * (7 + s * (-14 + s * (10 - 2.5 * s))) + jnp.maximum(share - 1.0, 0.0)


def _require_equal_length(times: Array | np.ndarray, levels: Array | np.ndarray) -> None:
    if times.shape != levels.shape or times.ndim < 1:
        raise InputError(
            f"times and levels must have one level a time, but have shapes {times.shape} and {levels.shape}; "
            "give two lists of equal length"
        )
