"""Levenberg-Marquardt by the search and the descent of optimistix, one step at a time, so that a fit can be watched,
interrupted, resumed, and run beside others."""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .._errors import SimulationError
from .._types import Scalar
from ._evaluation import Evaluated, Steps, ask, run_alone
from ._least_squares import LeastSquares, estimate_uncertainty, reduce_rows
from ._progress import CHI2_TOLERANCE, NEAR, NEAR_STEP_SIZE, STALL, STALL_TOLERANCE, Progress
from ._residuals import FitProblem

STALL_SHARE = 0.01
"""Part of chi^2 that the linear model may still promise for a stall to count; with more, a fit is lost."""

NEARLY, NEARLY_PROMISED = 0.3, 10.0
"""Gain in chi^2 of the last step, and that a full linear one promises, below which corrections may do the rest: half a
standard error in any one direction, and kinks promise what no step reaches."""

# Steps grow when three quarters of the predicted gain come true; the default of 99 % leaves a fit damped for long.
_SEARCH: optx.ClassicalTrustRegion = optx.ClassicalTrustRegion(high_cutoff=0.75)
_DESCENT: optx.DampedNewtonDescent = optx.DampedNewtonDescent()


Rows = Float[Array | np.ndarray, " rows"]
Columns = Float[Array | np.ndarray, "rows coordinates"]
Coordinates = Float[Array | np.ndarray, " coordinates"]


def _info(residuals: Rows, columns: Columns) -> optx.FunctionInfo.ResidualJac:
    return optx.FunctionInfo.ResidualJac(jnp.asarray(residuals), lx.MatrixLinearOperator(jnp.asarray(columns)))


@eqx.filter_jit
def _damped_step(residuals: Rows, columns: Columns, step_size: Scalar) -> Float[Array, " coordinates"]:
    info, like = _info(residuals, columns), jnp.zeros(columns.shape[1])
    return _DESCENT.step(step_size, _DESCENT.query(like, info, _DESCENT.init(like, info)))[0]


@eqx.filter_jit
def _judge(
    residuals: Rows, columns: Columns, here: Coordinates, trial: Coordinates, cost: Scalar, step_size: Scalar
) -> tuple[Array, Array]:
    """The size of the next step, and whether a trial of this cost is accepted."""
    info = _info(residuals, columns)
    state = eqx.tree_at(lambda state: state.step_size, _SEARCH.init(here, info), step_size)
    new_size, accepted, _, _ = _SEARCH.step(
        jnp.asarray(False), here, trial, info, optx.FunctionInfo.Eval(jnp.asarray(cost)), state
    )
    return new_size, accepted


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """A problem linearised: residuals and their Jacobian with respect to the coordinates, in units of the noise."""

    residuals: Float[np.ndarray, " residuals"]
    columns: Float[np.ndarray, "residuals coordinates"]

    @staticmethod
    def of(
        problem: FitProblem, here: Float[np.ndarray, " coordinates"], observed: Evaluated, slopes: "Slopes"
    ) -> "Point":
        """A problem with what is observed at `here`; derivatives may be those of a point nearby."""
        residuals = problem.residuals_of(observed.observed)
        columns = problem.columns_of(slopes.evaluated.columns, slopes.at)
        if problem.prior is not None:
            residuals = np.concatenate([residuals, np.asarray(problem.prior.residuals(here))])
            columns = np.concatenate([columns, np.diag(problem.prior.precision)])
        held = np.asarray(problem.transform.pinned(here, residuals @ columns))
        return Point(residuals, np.where(held, 0.0, columns))

    def bend(self, problem: FitProblem, here: Float[np.ndarray, " coordinates"], slopes: "Slopes") -> float:
        """By how many standard errors, over all directions, a linear step goes wrong for derivatives from elsewhere."""
        there = problem.residuals_of(slopes.evaluated.observed)
        traces = slice(len(there))
        moved = self.residuals[traces] - there
        bent, _ = reduce_rows(moved - self.columns[traces] @ (here - slopes.at), self.columns[traces])
        return float(np.linalg.norm(bent[:-1]))

    @functools.cached_property
    def reduced(self) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, "rows coordinates"]]:
        """The same linear problem in as many rows as there are coordinates, and one."""
        return reduce_rows(self.residuals, self.columns)

    def damped_step(self, size: float) -> Float[np.ndarray, " coordinates"]:
        """The step of Levenberg and Marquardt whose damping is `1 / size` times the mean square of a residual."""
        few, columns = self.reduced
        root = np.sqrt(len(self.residuals))
        return np.asarray(_damped_step(few / root, columns / root, np.array(float(size))))

    def promise(self, move: Float[np.ndarray, " coordinates"]) -> float:
        """By how much chi^2 would change along a move if the problem were linear."""
        few, columns = self.reduced
        moved = columns @ move
        return float(2 * few @ moved + moved @ moved)

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of all traces, and the coordinates that they are from."""

    at: Float[np.ndarray, " coordinates"]
    evaluated: Evaluated

    @staticmethod
    def find(problem: FitProblem, at: Float[np.ndarray, " coordinates"]) -> Steps["Slopes"]:
        """Derivatives at some coordinates."""
        evaluated = yield from ask(problem.evaluation(at, slopes=True))
        return Slopes(at, evaluated)


class LevenbergMarquardt:
    """A fit under way: minimises the cost of a problem step by step.

    A trial step whose simulation fails has infinite residuals: it is rejected and the step shortened, like any step
    that does not lower the cost. Derivatives are computed only where a trial is accepted.
    """

    def __init__(
        self, problem: FitProblem, progress: Progress, slopes: Slopes, point: Point, corrected_later: bool = False
    ):
        self.problem, self.progress, self.slopes, self.point = problem, progress, slopes, point
        self.corrected_later = corrected_later

    @classmethod
    def begin(
        cls, problem: FitProblem, progress: Progress, corrected_later: bool = False
    ) -> Steps["LevenbergMarquardt"]:
        """A search at its start, or at the last progress of an interrupted one.

        **Arguments:** `corrected_later`: whether linear steps follow it, so that it need not go to the last digit.

        **Raises:** `SimulationError` when the start itself can't be simulated.
        """
        here = np.array(progress.coordinates, float)
        slopes = yield from Slopes.find(problem, here)
        if slopes.evaluated.failed:
            raise SimulationError(
                "the simulation with the start values fails, so there is nothing to fit from; check the start "
                "values and the inputs of the traces"
            )
        point = Point.of(problem, here, slopes.evaluated, slopes)
        cost = 0.5 * point.chi2 / problem.count
        near = not progress.history and 2 * cost < NEAR
        # A search that goes on elsewhere than where it was has another cost there.
        progress = dataclasses.replace(
            progress,
            history=(*progress.history[:-1], cost),
            step_size=NEAR_STEP_SIZE if near else progress.step_size,
        )
        return cls(problem, progress, slopes, point, corrected_later)

    def step(self) -> Progress:
        """Tries one step, and says where the fit stands then."""
        return run_alone(self.steps())

    def steps(self) -> Steps[Progress]:
        """One step as a computation; see `step`."""
        problem, before = self.problem, self.progress
        here, root, size = np.array(before.coordinates, float), np.sqrt(problem.count), np.array(before.step_size)
        residuals, columns = (rows / root for rows in self.point.reduced)
        # A trial outside the bounds goes to the nearest point inside; what it then gains is judged by that move.
        trial = np.asarray(problem.transform.clip(here + np.asarray(_damped_step(residuals, columns, size))))
        evaluated = yield from ask(problem.evaluation(trial))
        cost = np.inf if evaluated.failed else problem.cost_of(evaluated.observed, trial)
        following, accepted = _judge(residuals, columns, here, trial, np.array(cost), size)
        if accepted:
            self.slopes = yield from Slopes.find(problem, trial)
            self.point = Point.of(problem, trial, self.slopes.evaluated, self.slopes)
        after = dataclasses.replace(
            before,
            coordinates=tuple((trial if accepted else here).tolist()),
            step_size=float(following),
            iteration=before.iteration + 1,
            accepted=before.accepted + bool(accepted),
            rejected_in_a_row=0 if accepted else before.rejected_in_a_row + 1,
            failed=before.failed + evaluated.failed,
            history=(*before.history, 0.5 * self.point.chi2 / problem.count if accepted else before.cost),
        )
        gain = 2 * problem.count * (before.cost - after.cost)
        # Before the first accepted step, rejections say that the start's damping is too small.
        stalled = before.accepted > 0 and before.iteration >= STALL and self._stands_still(after)
        converged = stalled or (bool(accepted) and (gain < CHI2_TOLERANCE or self._nearly_there(gain)))
        self.progress = dataclasses.replace(after, converged=converged, stalled=stalled)
        return self.progress

    def _nearly_there(self, gain: float) -> bool:
        """Whether corrections, which are full linear steps, may do the rest."""
        if not self.corrected_later or gain > NEARLY:
            return False
        return estimate_uncertainty(*self.point.reduced, self.problem.count).gain < NEARLY_PROMISED

    def _stands_still(self, progress: Progress) -> bool:
        """Whether the last trials gained next to nothing, and a full linear step promises no more."""
        twice = 2 * self.problem.count
        if twice * (progress.history[-1 - STALL] - progress.cost) >= STALL_TOLERANCE:
            return False
        promised = estimate_uncertainty(*self.point.reduced, self.problem.count).gain
        return promised < STALL_SHARE * twice * progress.cost

    def uncertainty(self) -> LeastSquares:
        """Of the linear problem at the accepted coordinates."""
        return estimate_uncertainty(*self.point.reduced, self.problem.count - self.problem.offsets)

    def linearisation(self) -> tuple[Float[np.ndarray, " residuals"], Float[np.ndarray, "residuals coordinates"]]:
        """Residuals in units of the noise, and their Jacobian, at the accepted coordinates."""
        return self.point.residuals, self.point.columns
