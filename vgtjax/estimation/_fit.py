"""Levenberg-Marquardt by optimistix, one step at a time, so that a fit can be watched, interrupted and resumed."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .._errors import SimulationError
from .._lanes import replicate
from .._types import Vector
from ._least_squares import estimate_uncertainty
from ._residuals import FitProblem
from ._seminormal import SeminormalEquations

CHI2_TOLERANCE = 0.01
"""A fit has converged when a step lowers chi^2 by less: a move of a tenth of a standard error in any one direction."""
STALL, STALL_TOLERANCE = 6, 0.1
"""A fit has also converged when so many trials together lower chi^2 by less than this. Kinks of the model (a plunger
that grazes its seat, a rod that sticks) leave a linear gain that no step reaches: on the slow loops of an actuator,
the steps after such a stall gained 0.3 of 18000 in sum, in 20 trials."""
STALL_SHARE = 0.01
"""Part of chi^2 that the linear model may still promise for a stall to count; with more, a fit is lost."""
NEAR = 2.0
"""A start with a lower chi^2 per measurement is near the end, and the first step is nearly Gauss and Newton's."""
NEAR_STEP_SIZE = 1e6
"""Inverse damping of that step. Damped as a far start must be, a near one needs ten steps to lose the damping; far
starts that begin like this are lost now and then."""
MAX_REJECTED = 20
"""Rejected trials in a row, each with a quarter of the step, after which a fit stands still."""
MAX_ITERATIONS = 100


@dataclasses.dataclass(frozen=True)
class Progress:
    """Where a fit stands after a step; enough to resume it exactly.

    `coordinates` are the accepted coordinates of the transform, `step_size` is the inverse of the damping, `history`
    the cost after every iteration, the start first (half the mean squared residual in units of the noise). `failed`
    counts trial steps whose simulation failed.

    A search that has converged may be corrected, in full linear steps, for what it tells of sensors and of numerical
    errors: `corrections` counts these, and `settled` says whether the last one would move anything that matters.
    `found` is where the search ended, `wanted` are the full linear steps from there on.
    """

    coordinates: tuple[float, ...]
    step_size: float = 1.0
    iteration: int = 0
    accepted: int = 0
    rejected_in_a_row: int = 0
    failed: int = 0
    converged: bool = False
    stalled: bool = False
    history: tuple[float, ...] = ()
    corrections: int = 0
    settled: bool = False
    found: tuple[float, ...] = ()
    wanted: tuple[tuple[float, ...], ...] = ()

    def corrected(self, coordinates: Iterable[float], wanted: Iterable[float]) -> "Progress":
        """After a correction that leads to these coordinates, whose cost is not known yet."""
        return dataclasses.replace(
            self,
            coordinates=tuple(coordinates),
            found=self.found if self.corrections else self.coordinates,
            wanted=(*self.wanted, tuple(wanted)) if self.corrections else (),
            iteration=self.iteration + 1,
            accepted=self.accepted + 1,
            corrections=self.corrections + 1,
        )

    @property
    def cost(self) -> float:
        """Cost at the accepted coordinates."""
        return self.history[-1]

    @property
    def finished(self) -> bool:
        """Whether another step would be wasted."""
        return self.converged or self.rejected_in_a_row >= MAX_REJECTED or self.iteration >= MAX_ITERATIONS

    @property
    def verdict(self) -> str:
        """Why the fit stopped, or that it has not."""
        if self.corrections and not self.settled:
            return f"not settled after {self.corrections} corrections for sensors and numerical errors"
        if self.corrections:
            return f"{self.corrections} corrections for sensors and numerical errors have settled"
        if self.converged and self.stalled:
            return f"the last {STALL} trials together lowered chi^2 by less than {STALL_TOLERANCE:g}"
        if self.converged:
            return f"the last step lowered chi^2 by less than {CHI2_TOLERANCE:g}"
        if self.rejected_in_a_row >= MAX_REJECTED:
            return f"stuck, {MAX_REJECTED} trial steps in a row did not lower the cost"
        if self.iteration >= MAX_ITERATIONS:
            return f"not converged after {MAX_ITERATIONS} iterations"
        return "running"


def _residuals(coordinates: Vector, problem: FitProblem) -> tuple[Array, None]:
    return problem.residuals(coordinates), None


# Steps grow when three quarters of the predicted gain come true; the default of 99 % leaves a fit damped for long.
_SOLVER: optx.LevenbergMarquardt = eqx.tree_at(
    lambda solver: solver.search,
    optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8, linear_solver=SeminormalEquations()),
    optx.ClassicalTrustRegion(high_cutoff=0.75),
)


@eqx.filter_jit
def _first_state(problem: FitProblem, coordinates: Array, step_size: Array) -> Any:
    """State before anything is evaluated.

    Compiled for what a second fit gains: optimistix keeps the traced residuals in its state and compares them by
    identity, so that only a state out of the same compiled function lets `_step` be reused.
    """
    shape = jax.eval_shape(lambda y: _residuals(y, problem)[0], coordinates)
    state = _SOLVER.init(_residuals, coordinates, problem, {}, shape, None, frozenset())
    return eqx.tree_at(lambda s: s.search_state.step_size, state, step_size)


@eqx.filter_jit
def _step(problem: FitProblem, coordinates: Array, state: Any) -> tuple[Array, Any, Array]:
    coordinates, state, _ = _SOLVER.step(_residuals, coordinates, problem, {}, state, frozenset())
    # A trial outside the bounds goes to the nearest point inside; what it then gains is judged by that move.
    state = eqx.tree_at(lambda s: s.y_eval, state, problem.transform.clip(state.y_eval))
    return replicate((coordinates, state, 0.5 * jnp.sum(state.f_info.residual**2)))


@eqx.filter_jit
def _is_finite(problem: FitProblem, coordinates: Array) -> Array:
    return jnp.all(jnp.isfinite(problem.residuals(coordinates)))


class LevenbergMarquardt:
    """A fit under way: minimises the cost of a problem step by step.

    A trial step whose simulation fails has infinite residuals: it is rejected and the step shortened, like any step
    that does not lower the cost.

    **Arguments:** `start`: coordinates of the transform, or the last progress of an interrupted fit.

    **Raises:** `SimulationError` when the start itself can't be simulated.
    """

    def __init__(self, problem: FitProblem, start: Float[np.ndarray, " parameters"] | Progress):
        self.problem = problem
        self.progress = start if isinstance(start, Progress) else Progress(tuple(np.asarray(start).tolist()))
        coordinates = jnp.asarray(self.progress.coordinates, dtype=float)
        state = _first_state(problem, coordinates, jnp.asarray(self.progress.step_size, dtype=float))
        # The first step of a state accepts its start and proposes a trial; it is no iteration of the fit.
        self._coordinates, self._state, cost = _step(problem, replicate(coordinates), replicate(state))
        if not np.isfinite(float(cost)):
            raise SimulationError(
                "the simulation with the start values fails, so there is nothing to fit from; check the start "
                "values and the inputs of the traces"
            )
        if len(self.progress.history) <= self.progress.iteration:
            self.progress = dataclasses.replace(self.progress, history=(*self.progress.history, float(cost)))
            if 2 * float(cost) < NEAR and not self.progress.corrections:
                state = _first_state(problem, coordinates, jnp.asarray(NEAR_STEP_SIZE))
                self._coordinates, self._state, _ = _step(problem, replicate(coordinates), replicate(state))

    def step(self) -> Progress:
        """Tries one step, and says where the fit stands then."""
        trial, before = self._state.y_eval, self.progress
        accepted_before = int(self._state.num_accepted_steps)
        self._coordinates, self._state, cost = _step(self.problem, self._coordinates, self._state)
        accepted = int(self._state.num_accepted_steps) > accepted_before
        failed = not accepted and not bool(_is_finite(self.problem, trial))
        gain = 2 * self.problem.count * (before.cost - float(cost))
        history = (*before.history, float(cost))
        recent = 2 * self.problem.count * (history[-1 - STALL :][0] - history[-1])
        # Before the first accepted step, rejections say that the start's damping is too small.
        stalled = before.accepted > 0 and before.iteration >= STALL and recent < STALL_TOLERANCE
        if stalled:  # what a full linear step would still take off
            promised = estimate_uncertainty(*self.linearisation(), self.problem.count).gain
            stalled = promised < STALL_SHARE * 2 * self.problem.count * float(cost)
        self.progress = dataclasses.replace(
            before,
            coordinates=tuple(np.asarray(self._coordinates).tolist()),
            step_size=float(self._state.search_state.step_size),
            iteration=before.iteration + 1,
            accepted=before.accepted + accepted,
            rejected_in_a_row=0 if accepted else before.rejected_in_a_row + 1,
            failed=before.failed + failed,
            converged=(accepted and gain < CHI2_TOLERANCE) or stalled,
            stalled=stalled,
            history=history,
        )
        return self.progress

    def linearisation(self) -> tuple[Float[np.ndarray, " residuals"], Float[np.ndarray, "residuals parameters"]]:
        """Residuals in units of the noise, and their Jacobian, at the accepted coordinates."""
        info = self._state.f_info
        scale = np.sqrt(self.problem.count)
        columns = np.asarray(info.jac.as_matrix()) if self.progress.coordinates else np.zeros((info.residual.size, 0))
        return np.asarray(info.residual) * scale, columns * scale
