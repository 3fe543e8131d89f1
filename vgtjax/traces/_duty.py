"""The duty that reaches the valve, when that is later or earlier than its record says."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._types import Scalar
from ._drive import Drive, Knot

Series = Float[Array, " time"]

SAME, STRAIGHT = 1e-6, 1e-6
"""Percent by which a duty may jump, and percent per second by which its rate may change, and go on as it was: far above
rounding, and far below what moves anything."""


def delay_duty(drive: Drive, delay: Scalar) -> Drive:
    """The inputs of a trace with a duty that arrives `delay` s late, with a knot in every interval in which it jumps or
    its rate changes.

    Where an interval has more than one knot, its mean counts, of a linear duty on the way from its start to its end.
    Before the first sample the duty was that of the first; intervals without length keep their duty. Derivatives are
    those of a duty a little later.
    """
    assert drive.pwm is not None, "only a duty can be late"
    assert drive.pwm_rate is not None, "a trace's duty has a rate"
    ends = jnp.cumsum(drive.duration)
    begins = ends - drive.duration
    lines = _Lines.of(drive.pwm, drive.pwm_rate, begins)
    before, behind = (lines.number(time - delay) for time in (begins, ends))
    count, last = lines.knots[behind] - lines.knots[before], jnp.searchsorted(lines.knots, lines.knots[behind])
    present = drive.duration > 0
    length = jnp.where(present, drive.duration, 1.0)
    mean = (lines.area_until(ends - delay, behind) - lines.area_until(begins - delay, before)) / length
    several, once = present & (count > 1), present & (count == 1)
    first, final = lines.at(begins - delay, before), lines.at(ends - delay, behind)
    chord = jnp.where(jnp.any(lines.rate != 0), (final - first) / length, 0.0)
    duty = jnp.where(several, mean - 0.5 * chord * length, first)
    knot = Knot(
        jump=jnp.where(once, lines.value[behind] - lines.at(lines.begin[last], before), 0.0),
        bend=jnp.where(once, lines.rate[behind] - lines.rate[before], 0.0),
        place=jnp.where(once, (lines.begin[last] + delay - begins) / length, 0.0),
    )
    rate = jnp.where(several, chord, jnp.where(present, lines.rate[before], 0.0))
    return dataclasses.replace(drive, pwm=jnp.where(present, duty, drive.pwm), pwm_rate=rate, knot=knot)


class _Lines(eqx.Module):
    """A duty as lines: one that holds before the first sample, and one from each. Where they begin in s, the number of
    knots until then, and the area under them in % s."""

    begin: Series
    value: Series
    rate: Series
    knots: Int[Array, " time"]
    area: Series

    @staticmethod
    def of(duty: Series, rate: Series, begins: Series) -> "_Lines":
        """The lines of a duty at its samples in s, and its rate until the next."""
        begin, value, rate = jnp.append(begins[:1], begins), jnp.append(duty[:1], duty), jnp.append(0.0, rate)
        since = jnp.diff(begin)
        jumps = jnp.append(0.0, value[1:] - value[:-1] - rate[:-1] * since)
        differs = (jnp.abs(jumps) > SAME) | (jnp.abs(jnp.diff(rate, prepend=0.0)) > STRAIGHT)
        area = jnp.append(0.0, jnp.cumsum((value[:-1] + 0.5 * rate[:-1] * since) * since))
        return _Lines(begin, value, rate, jnp.cumsum(differs), area)

    def number(self, time: Series) -> Int[Array, " time"]:
        """Which line there is just before each time."""
        return jnp.clip(jnp.searchsorted(self.begin, time) - 1, 0)

    def at(self, time: Series, line: Int[Array, " time"]) -> Series:
        """The duty at each time, on the line of that number."""
        return self.value[line] + self.rate[line] * (time - self.begin[line])

    def area_until(self, time: Series, line: Int[Array, " time"]) -> Series:
        """The area up to each time, on the line of that number."""
        since = time - self.begin[line]
        return self.area[line] + (self.value[line] + 0.5 * self.rate[line] * since) * since


FARTHEST_EDGE = 2
"""Samples by which an edge is moved at most."""
APART = 1e-6
"""s that an edge keeps from the times of a trace: far below what moves anything."""
HELD = 5
"""Samples for which a duty is the same before and after what is an edge, and no ramp."""


def edges_of(duty: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " edges"]:
    """Numbers of the samples at which a duty jumps from one level that it has held to another."""
    jumps = np.flatnonzero(np.diff(duty)) + 1
    held = np.diff(jumps, prepend=-HELD, append=len(duty) + HELD)
    return jumps[(held[:-1] >= HELD) & (held[1:] >= HELD)]


def inside(times: Float[np.ndarray, " edges"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " edges"]:
    """Times, those before or behind a clock next to its ends, one after the other."""
    places = 2 * APART * np.arange(1, len(times) + 1)
    return np.clip(times, clock[0] + places, clock[-1] - places[::-1])


def beside(times: Float[np.ndarray, " edges"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " edges"]:
    """Times, those that a clock has already a little earlier, so that they are times more."""
    nearest = _nearest(times, clock)
    return np.where(np.abs(times - nearest) < APART, nearest - APART, times)


def onto(times: Float[np.ndarray, " jumps"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " jumps"]:
    """Times, those next to one that a clock has already at that."""
    nearest = _nearest(times, clock)
    return np.where(np.abs(times - nearest) < APART, nearest, times)


def _nearest(times: Float[np.ndarray, " some"], clock: Float[np.ndarray, " time"]) -> Float[np.ndarray, " some"]:
    after = np.clip(np.searchsorted(clock, times), 1, len(clock) - 1)
    return np.where(times - clock[after - 1] < clock[after] - times, clock[after - 1], clock[after])
