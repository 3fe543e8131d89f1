"""Clocks of several channels brought together: the times at which a model is simulated."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from ._channel import Channel
from ._signals import SIGNALS

Times = Float[np.ndarray, " _"]  # each clock has its own length

SAME = 1e-9
"""Part of a trace's length by which times may differ and be the same: far above the rounding of a time stamp, 1e-16 of
it, and far below what moves anything, 10 ns in 10 s. Apart, they would begin an interval of no length to speak of,
which costs as many steps as the others."""


def same_clock(first: Times, second: Times) -> bool:
    """Whether two clocks have the same times."""
    return first is second or np.array_equal(first, second)


def share_time(channels: dict[str, Channel], time: ArrayLike | None) -> tuple[Times, dict[str, Channel], bool]:
    """The times at which a trace of some channels is simulated; `time` where it has none.

    **Returns:** those times in s, the channels with times that are the same made equal, and whether all of them have
    all of the times.

    **Raises:** `InputError` without any times, and when they have fewer than two samples in common time.
    """
    if not channels and time is None:
        raise InputError("a trace must have times, but there is no signal either; give time, or a Channel")
    clocks = [channel.time for channel in channels.values()] or [Channel(np.asarray(time), np.asarray(time)).time]
    spans = [np.array(channel.span) for channel in channels.values()]
    common = all(same_clock(clock, clocks[0]) for clock in clocks)
    if not common:
        aligned = _align(clocks + spans)
        clocks, spans = aligned[: len(clocks)], aligned[len(clocks) :]
        common = all(same_clock(clock, clocks[0]) for clock in clocks)
        channels = {
            name: dataclasses.replace(channel, time=clock, span=(float(span[0]), float(span[1])))
            for (name, channel), clock, span in zip(channels.items(), clocks, spans, strict=True)
        }
    if common:
        begin, end, times = clocks[0][0], clocks[0][-1], clocks[0]
    else:
        # A held signal goes on beyond its last sample, but nothing says what it was before its first.
        held = [SIGNALS[name].held for name in channels]
        begin = max(clock[0] if h else span[0] for h, clock, span in zip(held, clocks, spans, strict=True))
        end = min(span[1] for h, span in zip(held, spans, strict=True) if not h)
        union = np.unique(np.concatenate(clocks))
        times = union[(union >= begin) & (union <= end)]
    if len(times) < 2:
        raise InputError(
            "a trace must have at least two samples in the time that its signals share, but that runs from "
            f"{begin:g} s to {end:g} s; record more, or check the clocks"
        )
    return times, channels, common


def _align(clocks: Sequence[Times]) -> list[Times]:
    """The same clocks, with times that differ by less than `SAME` made equal."""
    union = np.unique(np.concatenate(clocks))
    shortest = min((float(np.min(np.diff(clock))) for clock in clocks if len(clock) > 1), default=np.inf)
    # Not even a chain with a time of every clock in it joins two times of one clock.
    apart = np.diff(union) > min(SAME * (union[-1] - union[0]), shortest / (1 + len(clocks)))
    first = np.append(True, apart)
    joined = union[first][np.cumsum(first) - 1]
    return [joined[np.searchsorted(union, clock)] for clock in clocks]
