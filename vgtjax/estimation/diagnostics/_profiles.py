"""The profile likelihood of single parameters: how far each may go while all others follow, and what interval that is.

The others follow by linear steps with the derivatives of the end of the fit, a chord, and every misfit is a real one.
So a profile is never below the true one: where it says that an interval is longer than the linear one, it is.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._types import Coordinates
from .._least_squares import NORMAL_95, pseudo_inverse
from ..derivatives import Computation, side_by_side
from ._slices import DOWNHILL, HONEST, End

RISE_95 = NORMAL_95**2
"""Rise of chi^2 at the ends of a 95 % interval of one parameter: 3.84."""
REACHES = (2.0, 4.0, 8.0)
"""Standard errors at which a profile is looked at, one after another until it has risen enough: four times the linear
interval is more than anybody would plan with."""
CHORDS = 3
"""Linear steps of the others at a point of a profile, at most."""
ENOUGH = 0.1
"""Gain in chi^2 below which no further linear step is taken: it moves the end of an interval by a fortieth of it."""
MOST_PROFILES = 6
"""Parameters that get a profile unless more are asked for: each takes about six simulations of all traces."""


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """The misfit while one entry is held at `reaches` in standard errors from its value, and all others follow.

    `ends` are where it crosses `RISE_95`, in the same units: infinite where it does not. `limits` are the reaches that
    bounds leave, where they end the profile before it has risen.
    """

    entry: str
    error: float
    """Its standard error in coordinates."""
    reaches: tuple[float, ...]
    values: tuple[float, ...]
    ends: tuple[float, float]
    limits: tuple[float, float]

    @property
    def verdict(self) -> str:
        """What the profile says of the entry, in words."""
        if np.min(self.values) < DOWNHILL:
            return "the misfit is lower elsewhere: the fit did not end at its minimum"
        low, high = (bool(np.isfinite(end)) for end in self.ends)
        if low and high:
            below, above = np.abs(self.ends)
            skewed = max(below, above) > HONEST * min(below, above)
            return "bounded on both sides" + (", not symmetric" if skewed else "")
        known = [side for side, is_known in (("below", low), ("above", high)) if is_known]
        return f"bounded only from {known[0]}" if known else "flat: not determined"

    def widened(self, linear: float) -> tuple[float, float]:
        """Ends of a 95 % interval, as distances from the value in coordinates, by what the linear one reaches there.

        A profile makes an interval longer and never shorter, as a chord overestimates the misfit, but for one that a
        bound ends: that lies on it. Open ends are infinite.
        """
        below, above = (self.error * each for each in self.limits)
        begin = below if np.isinf(self.ends[0]) else min(self.error * self.ends[0], -linear)
        return begin, above if np.isinf(self.ends[1]) else max(self.error * self.ends[1], linear)


@dataclasses.dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles by entry; `left_out` are entries that should have one, too, but were beyond the limits."""

    profiles: dict[str, Profile]
    left_out: list[str]
    evaluations: int


def profiling(end: End, entries: Sequence[str], most: int = MOST_PROFILES) -> Computation[Profiles]:
    """Profiles of the first entries, `most` of them, as a computation; those not determined have none."""
    told = dict(zip(end.entries, end.found.determined(end.problem.transform.positive), strict=True))
    wanted = [entry for entry in entries if told[entry]]
    held = [_Held(end, end.entries.index(entry)) for entry in wanted[:most]]
    found = yield from side_by_side([each.profile() for each in held])
    return Profiles(dict(zip(wanted, found, strict=False)), wanted[most:], sum(each.evaluations for each in held))


class _Side(NamedTuple):
    """Half of a profile: its points, where it has risen enough, and what bounds leave."""

    rows: list[tuple[float, float]]
    end: float
    limit: float


class _Held:
    """One coordinate held, the others free: steps of these by the derivatives at the end."""

    def __init__(self, end: End, number: int):
        self.end, self.number, self.evaluations = end, number, 0
        self.error = float(end.found.std_errors[number])
        triangle = end.point.reduced.columns
        others = np.delete(triangle, number, axis=1)
        self.inverse = np.insert(pseudo_inverse(others), number, 0.0, axis=0)
        self.along = -self.inverse @ triangle[:, number]
        self.along[number] = 1.0

    def profile(self) -> Computation[Profile]:
        """Both sides, each until the misfit has risen enough."""
        below, above = yield from side_by_side([self._side(-1.0), self._side(1.0)])
        reaches, values = zip(*sorted([(0.0, 0.0), *below.rows, *above.rows]), strict=True)
        name = self.end.entries[self.number]
        return Profile(name, self.error, reaches, values, (below.end, above.end), (below.limit, above.limit))

    def _side(self, side: float) -> Computation["_Side"]:
        rows = [(0.0, 0.0)]
        extra, limit = np.zeros(len(self.along)), side * np.inf
        for reach in REACHES:
            there, rise, extra = yield from self._at(side * reach, extra * 2)
            reached = there / self.error
            if abs(reached) > abs(rows[-1][0]) + 1e-9:
                rows.append((reached, rise))
            if abs(reached) < 0.99 * reach:
                limit = reached
                break
            if rise >= RISE_95:
                break
        if rows[-1][1] >= RISE_95 and len(rows) == 2:
            # The shape between is what the crossing is read from.
            middle, rise, _ = yield from self._at(rows[-1][0] / 2, extra / 2)
            rows.insert(1, (middle / self.error, rise))
        return _Side(rows[1:], side * _crossing(rows), limit)

    def _at(self, reach: float, extra: Coordinates) -> Computation[tuple[float, float, Coordinates]]:
        """How far the held coordinate went, the lowest rise that linear steps of the others found there, and what they
        went beyond the first of them."""
        end, fixed = self.end, self.end.at[self.number] + reach * self.error
        straight = end.at + reach * self.error * self.along
        best, rise, tried = extra, np.inf, extra
        for _ in range(1 + CHORDS):
            there = straight + tried
            there[self.number] = fixed
            there = end.clipped(there)
            residuals = yield from end.residuals(there)
            self.evaluations += 1
            found = end.rise(residuals)
            if residuals is None or found >= rise - ENOUGH:
                best, rise = (best, rise) if found >= rise else (there - straight, found)
                break
            best, rise = there - straight, found
            step, promised = self._step(residuals)
            if promised < ENOUGH:
                break
            tried = best + step
        best = best.copy()
        gone = float(end.clipped(np.where(np.arange(len(best)) == self.number, fixed, end.at))[self.number])
        best[self.number] = 0.0
        return gone - float(end.at[self.number]), rise, best

    def _step(self, residuals: np.ndarray) -> tuple[Coordinates, float]:
        """The linear step of the others, and the gain that it promises."""
        part = self.inverse.T @ (self.end.point.columns.T @ residuals)
        return -self.inverse @ part, float(part @ part) / self.end.found.scale


def _crossing(rows: Sequence[tuple[float, float]]) -> float:
    """The distance at which the misfit has risen by `RISE_95`; its root is straight between points, as a parabola's."""
    for (near, low), (far, high) in itertools.pairwise(rows):
        if high < RISE_95:
            continue
        if np.isinf(high):
            return abs(far)  # a simulation that fails says only that it is no farther
        below, above = np.sqrt(max(low, 0.0)), np.sqrt(high)
        return abs(near) + (NORMAL_95 - below) / (above - below) * abs(far - near)
    return np.inf
