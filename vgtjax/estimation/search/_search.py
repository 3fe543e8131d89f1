"""Levenberg-Marquardt that makes much of each Jacobian, a step at a time, so that a fit can be watched, interrupted,
resumed, and run beside others.

Derivatives of a unit with fifty parameters take as long as 25 simulations side by side. So one step, which is what a
Jacobian is good for, is a number of moves: each tries several dampings at once and takes the best, and tells the linear
problem what the misfit really did along it. A fit of four traces takes 7 Jacobians, and took 20 with one trial each.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..._errors import SimulationError
from ..._types import Coordinates
from .._least_squares import LeastSquares
from ..derivatives import Computation, run_alone, side_by_side
from ..measurements import FitProblem
from ._point import Point, Reduced, Secant, misfit_at
from ._progress import CHI2_TOLERANCE, STALL_TOLERANCE, Progress
from ._slopes import Slopes

SPREAD = (0.03, 0.3, 3.0, 30.0)
"""Sizes that are tried at once, in units of the one that was best before: as many as fill a core's vector units."""
SMALLER = 1e-4
"""Factor of all sizes where none of them lowers the misfit: the next ones to try."""
MOST_MOVES, MOST_RETRIES = 6, 4
"""Moves by one Jacobian, and how often all sizes may be made smaller before the first of them."""
WORTHWHILE = 0.15
"""Part of the whole gain by a Jacobian that its last move must have brought for another one."""
TRUE = 0.25
"""Part of its promise that a move must have kept for another one by the same Jacobian."""
STALL_SHARE, REACH = 0.01, 0.2
"""Part of chi^2 that the linear model may still promise for a stall to count; with more, a fit is lost. It is believed
for moves of up to `REACH` in each coordinate: at a kink it promised a hundredth of chi^2, by values times 10^22."""
LEAST_GAIN = 1e-9
"""Part of chi^2 by which a trial has to lower it; less is rounding, and a search went on for sixty steps by it."""
NEARLY, NEARLY_PROMISED = 0.3, 10.0
"""Gain in chi^2 of the last step, and that a full linear one promises, below which corrections may do the rest: half a
standard error in any one direction, and kinks promise what no step reaches."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Stand:
    """Where a step stands between its moves: coordinates, residuals there, and the best size of a move so far."""

    here: Coordinates
    residuals: Float[np.ndarray, " residuals"]
    size: float
    failed: int = 0
    rejected: int = 0

    @property
    def chi2(self) -> float:
        return float(self.residuals @ self.residuals)


class LevenbergMarquardt:
    """A fit under way: minimises the cost of a problem step by step.

    A trial whose simulation fails has infinite residuals: it is rejected, like any that does not lower the cost.
    """

    def __init__(
        self, problem: FitProblem, progress: Progress, slopes: Slopes, point: Point, corrected_later: bool = False
    ):
        self.problem, self.progress, self.slopes, self.point = problem, progress, slopes, point
        self.corrected_later = corrected_later

    @classmethod
    def begin(
        cls,
        problem: FitProblem,
        progress: Progress,
        corrected_later: bool = False,
        slopes: Slopes | None = None,
    ) -> Computation["LevenbergMarquardt"]:
        """A search at its start, or at the last progress of an interrupted one.

        **Arguments:** `corrected_later`: whether linear steps follow it, so that it need not go to the last digit;
        `slopes`: derivatives where it begins, if they are known.

        **Raises:** `SimulationError` when the start itself can't be simulated.
        """
        here = np.array(progress.coordinates, float)
        slopes = (yield from Slopes.find(problem, here)) if slopes is None else slopes
        if slopes.evaluated.failed:
            raise SimulationError(
                "the simulation with the start values fails, so there is nothing to fit from; check the start "
                f"values and the inputs of the traces. {slopes.evaluated.failure}"
            )
        point = Point.of(problem, here, slopes.evaluated, slopes)
        # A search that goes on elsewhere than where it was has another cost there.
        history = (*progress.history[:-1], 0.5 * point.chi2 / problem.count)
        began = dataclasses.replace(progress, history=history, began=progress.began or progress.coordinates)
        return cls(problem, began, slopes, point, corrected_later)

    def step(self) -> Progress:
        """Takes one step, which is as far as one Jacobian leads, and says where the fit stands then."""
        return run_alone(self.steps())

    def steps(self) -> Computation[Progress]:
        """One step as a computation; see `step`."""
        problem, before = self.problem, self.progress
        here = np.array(before.coordinates, float)
        stand = yield from self._moved(_Stand(here, self.point.residuals, before.step_size))
        accepted, chi2 = stand.here is not here, self.point.chi2
        gain = chi2 - stand.chi2
        if accepted:
            self.slopes = yield from Slopes.find(problem, stand.here)
            self.point = Point.of(problem, stand.here, self.slopes.evaluated, self.slopes)
        after = dataclasses.replace(
            before,
            coordinates=tuple(stand.here.tolist()),
            step_size=stand.size,
            iteration=before.iteration + 1,
            accepted=before.accepted + accepted,
            rejected=before.rejected + stand.rejected,
            failed=before.failed + stand.failed,
            history=(*before.history, 0.5 * self.point.chi2 / problem.count),
        )
        promised = self.point.uncertainty(problem.count).gain
        stalled = before.accepted > 0 and gain < STALL_TOLERANCE and self._nearby() < STALL_SHARE * self.point.chi2
        converged = self._arrived(gain if accepted else np.inf, promised)
        self.progress = dataclasses.replace(
            after,
            converged=converged or stalled,
            stalled=stalled and not converged,
            # Programs with and without derivatives round differently, which friction that sticks and slips makes more
            # of: by that alone a search gained from one place, fifty times, while its moves went to 1e-300.
            stuck=not (converged or stalled or (accepted and self.point.chi2 < (1 - LEAST_GAIN) * chi2)),
        )
        return self.progress

    def _arrived(self, gain: float, promised: float) -> bool:
        """Whether the last step gained next to nothing, or another one would."""
        if self.corrected_later:
            return promised < NEARLY or (gain < NEARLY and promised < NEARLY_PROMISED)
        return min(gain, promised) < CHI2_TOLERANCE

    def _nearby(self) -> float:
        """What the linear problem promises as far as it is believed."""
        reduced = self.point.reduced
        steps = reduced.damped_steps(np.logspace(-6, 9, 16).tolist())
        return max((-reduced.promise(step) for step in steps if np.max(np.abs(step)) <= REACH), default=0.0)

    def _moved(self, stand: _Stand) -> Computation[_Stand]:
        """Moves as long as the Jacobian of where they begin, and what they learn on the way, are good for them."""
        secant, start = Secant.of(self.point), stand
        for _ in range(MOST_MOVES):
            onward = yield from self._move(secant.reduced, stand, retries=MOST_RETRIES if stand is start else 0)
            gain, move = stand.chi2 - onward.chi2, onward.here - stand.here
            if gain <= 0:
                return onward
            promised = -secant.reduced.promise(move)
            secant, stand = secant.moved(move, onward.residuals), onward
            if gain < TRUE * promised or gain < WORTHWHILE * (start.chi2 - onward.chi2):
                break
        return stand

    def _move(self, reduced: Reduced, stand: _Stand, retries: int) -> Computation[_Stand]:
        """The best of the trials from where a step stands; all of them smaller, so often, if none lowers the misfit."""
        for _ in range(1 + retries):
            sizes = [stand.size * factor for factor in SPREAD]
            # A trial outside the bounds goes to the nearest point inside; what it then gains is judged by that move.
            moved, clip = stand.here + self._near(reduced.damped_steps(sizes)), self.problem.transform.clip
            trials = [np.asarray(clip(trial)) for trial in moved]
            found = yield from side_by_side([misfit_at(self.problem, trial) for trial in trials])
            chi2 = [np.inf if each is None else float(each @ each) for each in found]
            best, failed = int(np.argmin(chi2)), stand.failed + chi2.count(np.inf)
            residuals = found[best]
            if residuals is not None and chi2[best] < (1 - LEAST_GAIN) * stand.chi2:
                return _Stand(trials[best], residuals, sizes[best], failed, stand.rejected)
            stand = dataclasses.replace(stand, size=SMALLER * stand.size, failed=failed, rejected=stand.rejected + 1)
        return stand

    def _near(self, steps: Float[np.ndarray, "sizes coordinates"]) -> Float[np.ndarray, "sizes coordinates"]:
        """Steps along the same ways, none so long that nothing is known of where it ends."""
        longest = np.max(np.abs(steps), axis=1, keepdims=True, initial=0.0)
        return steps * np.minimum(1.0, self.progress.longest / np.maximum(longest, 1e-300))

    def uncertainty(self) -> LeastSquares:
        """Of the linear problem at the accepted coordinates."""
        return self.point.uncertainty(self.problem.count - self.problem.offsets)

    def linearisation(self) -> tuple[Float[np.ndarray, " residuals"], Float[np.ndarray, "residuals coordinates"]]:
        """Residuals in units of the noise, and their Jacobian, at the accepted coordinates."""
        return self.point.residuals, self.point.columns
