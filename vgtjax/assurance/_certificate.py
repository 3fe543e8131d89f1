"""Whether the derivatives that a fit's errors rest on are those of its misfit: forward mode, which made the columns,
against reverse mode and against differences."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .._types import Coordinates
from ..estimation import (
    Calibrator,
    Computation,
    FitProblem,
    LevenbergMarquardt,
    Point,
    Report,
    misfit_at,
    quiet,
    side_by_side,
)
from ._modes import Modes

DIRECTIONS = 4
"""Random directions along which all columns are tried together."""
REACH = 0.01
"""Standard errors, of each column by itself, that a difference reaches to either side: far enough for rounding, and
near enough for curves and kinks."""
WRONG = 0.02
"""Part of a difference by which columns may miss it along a random direction before each is asked by itself. Where the
misfit is smooth it is 0.0003, kinks of a rod that sticks make it 0.01 to 1; one column of 51 that is twice what it
should be makes it 0.06."""
WRONG_ALONE = 0.3
"""The same for one column by itself, where that is asked for: a kink of a small problem with Dahl's friction leaves
0.16, a column that is twice what it should be 0.5."""
NEARER = (0.25, 0.0625, 0.02)
"""Parts of the way on which such a column is asked again: a kink beside the end is beyond it then, and what is wrong
stays wrong. One column of loops that stick and slip missed 0.1 or 0.31, as rounding had it, another 0.67 on the first
of these ways."""
FARTHEST = 0.05
"""Coordinates by which nothing is moved farther, however little it shows."""
DEAD = 1e-3
"""Coordinates by which what seems to change nothing is moved."""
MOST_NAMED = 5
"""Wrong derivatives that are named one by one; with more the simulation itself is chaotic there."""
NOTHING = 1e-4
"""Standard errors that are no change at all."""
SEED = 2012


@dataclasses.dataclass(frozen=True, eq=False)
class Certificate:
    """What differences and reverse mode say of the derivatives at the end of a fit.

    `mismatches` are the parts of the differences that columns miss along random directions, NaN where a simulation
    failed; `modes` the parts by which forward and reverse mode differ along the same, and `repeated` the part that they
    may: more than rounding where forward mode at places a rounding away differs from itself. `alone` has the part of
    a difference for columns that were asked one by one. `dead` entries change nothing, by their column and by a
    difference; `bounding` ones nothing to one side, so that their value is a bound; `exploded` ones have a column that
    is no number; `unequal` ones one that is not what reverse mode finds, with the part by which it is off.
    """

    mismatches: Sequence[float]
    modes: Sequence[float]
    repeated: float
    alone: dict[str, float]
    dead: Sequence[str]
    bounding: dict[str, str]
    exploded: Sequence[str]
    unequal: dict[str, float]

    @property
    def wrong(self) -> dict[str, float]:
        """Entries with a column that is not what a difference shows, and the part by which it is off."""
        return {name: part for name, part in self.alone.items() if part > WRONG_ALONE}

    @property
    def unchecked(self) -> list[str]:
        """Entries whose derivative was to be compared by itself, but every simulation for that failed."""
        return [name for name, part in self.alone.items() if not np.isfinite(part)]

    @property
    def uncompared(self) -> list[str]:
        """What no derivative at all could be compared with."""
        asked = self.mismatches if largest(self.mismatches) <= WRONG else [*self.alone.values()]
        against = {"differences": asked, "reverse mode": self.modes}
        return [name for name, found in against.items() if not np.any(np.isfinite(found))]

    @property
    def passed(self) -> bool:
        """Whether errors may be believed as far as derivatives go."""
        return not (self.exploded or self.wrong or self.unequal or self.unchecked or self.uncompared)

    def summary(self) -> dict[str, Any]:
        """All of it for JSON; `None` for what could not be simulated."""
        return {
            "passed": self.passed,
            "forward_against_differences": [None if np.isnan(each) else each for each in self.mismatches],
            "forward_against_reverse": [None if np.isnan(each) else each for each in self.modes],
            "reverse_limit": self.repeated,
            "dead_columns": list(self.dead),
            "bounding_columns": self.bounding,
            "exploded_columns": list(self.exploded),
            "wrong_columns": self.wrong,
            "unequal_columns": self.unequal,
        }

    @property
    def sentence(self) -> str:
        """What is to be said of it."""
        if self.passed:
            return f"{self._agreement}, with reverse mode to {largest(self.modes):.1g}"
        said = [f"the derivative with respect to {name} is no number" for name in self.exploded]
        if len(self.wrong) > MOST_NAMED:
            return f"the gradient certificate failed: {len(self.wrong)} derivatives are off: the misfit is not smooth"
        said += [
            f"the derivative with respect to {name} is off by {100 * part:.0f} %" for name, part in self.wrong.items()
        ]
        said += self._said_of_modes
        said += [f"derivatives could not be compared with {name}, as simulations failed" for name in self.uncompared]
        alone = [] if "differences" in self.uncompared else self.unchecked
        said += [
            f"the derivative with respect to {name} could not be compared with differences, as simulations failed"
            for name in alone
        ]
        return f"the gradient certificate failed: {'; '.join(said)}"

    @property
    def remarks(self) -> list[str]:
        """What is to be said of it besides."""
        more = {"least": "a larger value would change nothing", "most": "a smaller value would change nothing"}
        return [f"the value of {name} is a bound: {more[side]}" for name, side in self.bounding.items()]

    @property
    def _said_of_modes(self) -> list[str]:
        """What is to be said of derivatives that reverse mode does not find."""
        apart = {name: part for name, part in self.unequal.items() if name not in self.wrong}
        if len(apart) > MOST_NAMED:
            return [f"{len(apart)} derivatives differ from reverse mode, by up to {100 * max(apart.values()):.2g} %"]
        return [
            f"the derivative with respect to {name} differs from reverse mode by {100 * part:.2g} %"
            for name, part in apart.items()
        ]

    @property
    def _agreement(self) -> str:
        """How well differences are met, by the columns together or else one by one."""
        worst = largest(self.mismatches)
        if worst <= WRONG:
            return f"derivatives agree with differences to {100 * worst:.2g} %"
        return (
            "derivatives with respect to one parameter agree with differences to "
            f"{100 * largest(self.alone.values()):.2g} %, along random directions to {100 * worst:.2g} %, as the "
            "misfit has a kink there"
        )


def largest(parts: Iterable[float]) -> float:
    """The largest part that is a number; infinite without one."""
    return max((part for part in parts if np.isfinite(part)), default=np.inf)


def certified(calibrator: Calibrator, report: Report = quiet) -> Computation[tuple[Calibrator, Certificate]]:
    """A calibration at its end with its certificate, as a computation; where that fails, and slow traces have longer
    steps than others, a search goes on from there without these, and is asked again.

    Rough in one of twenty units with three slow loops each is what 1 ms makes of a stop; 0.5 ms leave it smooth.
    """
    certificate = yield from certifying(calibrator)
    if certificate.passed or not calibrator.task.lengthens:
        return calibrator, certificate
    finer = yield from calibrator.at(calibrator.minimiser.progress.refined())
    report(finer.minimiser.progress)
    finer = yield from finer.ending(report)
    return finer, (yield from certifying(finer))


def certifying(calibrator: Calibrator) -> Computation[Certificate]:
    """The certificate of a calibration at its end, by the derivatives of that place itself, as a computation.

    One sweep in reverse mode, two simulations a direction, and two to eight an entry where these disagree.
    """
    search, entries = calibrator.minimiser, calibrator.task.selection.entries
    problem, at = search.problem, search.slopes.at
    columns = _columns(search)
    lengths = np.linalg.norm(columns, axis=0)
    usable = np.isfinite(lengths) & (lengths > 0)
    names = [*entries, "duty_delay"][: len(at)]
    steps = np.where(usable, np.minimum(REACH / np.where(usable, lengths, 1.0), FARTHEST), 0.0)
    signs = np.random.default_rng(SEED).choice([-1.0, 1.0], (DIRECTIONS, len(at)))
    moves = signs * steps
    differences = yield from side_by_side([_difference(problem, at, move) for move in moves])
    clean = np.where(usable, columns, 0.0)
    mismatches = [_miss(clean @ move, found) for move, found in zip(moves, differences, strict=True)]
    held = np.asarray(problem.transform.at_bound(np.asarray(search.progress.coordinates)))
    modes = yield from Modes.compare(problem, search.slopes, clean, moves, np.isfinite(lengths) & ~held)
    silent = [number for number in np.flatnonzero(lengths == 0).tolist() if not held[number]]
    suspects = list(range(len(at))) if largest(mismatches) > WRONG else silent
    suspects = [number for number in suspects if np.isfinite(lengths[number]) and not held[number]]
    axes = {names[number]: np.eye(len(at))[number] * (steps[number] or DEAD) for number in suspects}
    parts = yield from _alone(problem, at, clean, axes)
    for part in NEARER:
        again = {name: part * axis for name, axis in axes.items() if not parts[name] <= WRONG_ALONE}
        nearer = yield from _alone(problem, at, clean, again)
        # Neither what failed nor a move that changes nothing clears a derivative.
        parts |= {name: float(np.fmin(parts[name], found)) for name, found in nearer.items() if found > 0}
    missed = [names[number] for number in silent if parts[names[number]] > WRONG_ALONE]
    bounding = yield from _bounding(problem, at, {name: axes[name] for name in missed})
    return Certificate(
        mismatches,
        modes.along,
        float(np.max(modes.allowed)),
        {name: part for name, part in parts.items() if name not in bounding},
        [names[number] for number in silent if not parts[names[number]] > 0],
        bounding,
        [name for name, length in zip(names, lengths, strict=True) if not np.isfinite(length)],
        {names[number]: float(modes.apart[number]) for number in np.flatnonzero(modes.unequal).tolist()},
    )


def _columns(search: LevenbergMarquardt) -> Float[np.ndarray, "rows coordinates"]:
    """Derivatives at the end itself, and by what those that errors rest on differ from what they should be, means."""
    here, residuals = np.asarray(search.progress.coordinates), search.point.residuals
    own, mean = (
        Point.by(search.problem, here, residuals, slopes).columns for slopes in (search.slopes.alone, search.slopes)
    )
    same = (search.point.columns == mean) | (np.isnan(search.point.columns) & np.isnan(mean))
    return own + np.where(same, 0.0, search.point.columns - mean)


def _alone(
    problem: FitProblem, at: Coordinates, columns: Float[np.ndarray, "rows coordinates"], axes: dict[str, Coordinates]
) -> Computation[dict[str, float]]:
    """Part of the difference along each axis that its column does not explain."""
    found = yield from side_by_side([_difference(problem, at, axis) for axis in axes.values()])
    return {name: _miss(columns @ axis, each) for (name, axis), each in zip(axes.items(), found, strict=True)}


def _bounding(problem: FitProblem, at: Coordinates, axes: dict[str, Coordinates]) -> Computation[dict[str, str]]:
    """Which value the end is, "least" or "most", of axes along which one side alone changes anything.

    A column of zeros is right there: the rod that just reaches its end stop bounds the travel from below. A column that
    ought not to be zero misses on both sides.
    """
    if not axes:
        return {}
    places = [at, *(at + sign * axis for axis in axes.values() for sign in (1, -1))]
    here, *sides = yield from side_by_side([misfit_at(problem, place) for place in places])
    found = {}
    for name, ahead, behind in zip(axes, sides[::2], sides[1::2], strict=True):
        if here is None or ahead is None or behind is None:
            continue
        up, down = (float(np.linalg.norm(side - here)) > NOTHING for side in (ahead, behind))
        if up != down:
            found[name] = "most" if up else "least"
    return found


def _difference(
    problem: FitProblem, at: Coordinates, move: Coordinates
) -> Computation[Float[np.ndarray, " residuals"] | None]:
    """Half of the change of the residuals from one side to the other; bounds don't count."""
    ahead, behind = yield from side_by_side([misfit_at(problem, at + move), misfit_at(problem, at - move)])
    return None if ahead is None or behind is None else 0.5 * (ahead - behind)


def _miss(expected: Float[np.ndarray, " residuals"], found: Float[np.ndarray, " residuals"] | None) -> float:
    """Part of a difference that columns don't explain; NaN without one."""
    if found is None:
        return np.nan
    size = max(float(np.linalg.norm(found)), float(np.linalg.norm(expected)))
    return float(np.linalg.norm(found - expected)) / size if size > NOTHING else 0.0
