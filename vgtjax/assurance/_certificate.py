"""Whether the derivatives that a fit's errors rest on are those of its misfit: columns against differences."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..estimation import Calibrator, FitProblem, Steps, misfit_at, side_by_side

DIRECTIONS = 4
"""Random directions along which all columns are tried together."""
REACH = 0.01
"""Standard errors, of each column by itself, that a difference reaches to either side: far enough for rounding, and
near enough for curves and kinks."""
WRONG = 0.02
"""Part of a difference by which columns may miss it along a random direction. At the ends of our fits it is 0.0003; one
column of 51 that is twice what it should be makes it 0.06."""
WRONG_ALONE = 0.3
"""The same for one column by itself, where that is asked for: a kink of a small problem with Dahl's friction leaves
0.16, a column that is twice what it should be 0.5."""
FARTHEST = 0.05
"""Coordinates by which nothing is moved farther, however little it shows."""
DEAD = 1e-3
"""Coordinates by which what seems to change nothing is moved."""
MOST_NAMED = 5
"""Wrong derivatives that are named one by one; with more the simulation itself is chaotic there."""
NOTHING = 1e-4
"""Standard errors that are no change at all."""
SEED = 2012

Coordinates = Float[np.ndarray, " coordinates"]


@dataclasses.dataclass(frozen=True, eq=False)
class Certificate:
    """What differences say of the derivatives at the end of a fit.

    `mismatches` are the parts of the differences that columns miss along random directions, NaN where a simulation
    failed. `dead` entries change nothing, by their column and by a difference; `exploded` ones have a column that is no
    number; `wrong` ones have a column that is not what a difference shows, with the part by which it is off.
    """

    mismatches: Sequence[float]
    dead: Sequence[str]
    exploded: Sequence[str]
    wrong: dict[str, float]

    @property
    def passed(self) -> bool:
        """Whether errors may be believed as far as derivatives go."""
        return not self.exploded and not self.wrong

    def summary(self) -> dict[str, Any]:
        """All of it for JSON; `None` for what could not be simulated."""
        return {
            "passed": self.passed,
            "forward_against_differences": [None if np.isnan(each) else each for each in self.mismatches],
            "dead_columns": list(self.dead),
            "exploded_columns": list(self.exploded),
            "wrong_columns": self.wrong,
        }

    @property
    def sentence(self) -> str:
        """What is to be said of it."""
        worst = float(np.nanmax(self.mismatches, initial=0.0))
        if self.passed:
            kink = "" if worst <= WRONG else ", as the misfit has a kink there; no column by itself is wrong"
            return f"derivatives agree with differences to {100 * worst:.2g} %{kink}"
        said = [f"the derivative by {name} is no number" for name in self.exploded]
        if len(self.wrong) > MOST_NAMED:
            return f"the gradient certificate failed: {len(self.wrong)} derivatives are off: the misfit is not smooth"
        said += [f"the derivative by {name} is off by {100 * part:.0f} %" for name, part in self.wrong.items()]
        return f"the gradient certificate failed: {'; '.join(said)}"


def certifying(calibrator: Calibrator) -> Steps[Certificate]:
    """The certificate of a calibration at its end, as a computation: two simulations a direction, and two an entry
    where these disagree."""
    search, entries = calibrator.minimiser, calibrator.task.selection.entries
    problem, at = search.problem, search.slopes.at
    columns = np.asarray(search.point.columns)
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
    silent = [number for number in np.flatnonzero(lengths == 0).tolist() if not held[number]]
    suspects = list(range(len(at))) if np.nanmax(mismatches, initial=0.0) > WRONG else silent
    suspects = [number for number in suspects if np.isfinite(lengths[number]) and not held[number]]
    axes = [np.eye(len(at))[number] * (steps[number] or DEAD) for number in suspects]
    alone = yield from side_by_side([_difference(problem, at, axis) for axis in axes])
    parts = {
        names[number]: _miss(clean @ axis, found) for number, axis, found in zip(suspects, axes, alone, strict=True)
    }
    return Certificate(
        mismatches,
        [names[number] for number in silent if not parts[names[number]] > 0],
        [name for name, length in zip(names, lengths, strict=True) if not np.isfinite(length)],
        {name: part for name, part in parts.items() if part > WRONG_ALONE},
    )


def _difference(
    problem: FitProblem, at: Coordinates, move: Coordinates
) -> Steps[Float[np.ndarray, " residuals"] | None]:
    """Half of the change of the residuals from one side to the other; bounds don't count."""
    if not np.any(move):
        return np.zeros(1)
    ahead, behind = yield from side_by_side([misfit_at(problem, at + move), misfit_at(problem, at - move)])
    return None if ahead is None or behind is None else 0.5 * (ahead - behind)


def _miss(expected: Float[np.ndarray, " residuals"], found: Float[np.ndarray, " residuals"] | None) -> float:
    """Part of a difference that columns don't explain; NaN without one."""
    if found is None:
        return np.nan
    size = max(float(np.linalg.norm(found)), float(np.linalg.norm(expected)))
    return float(np.linalg.norm(found - expected)) / size if size > NOTHING else 0.0
