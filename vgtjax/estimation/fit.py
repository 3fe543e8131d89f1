"""Levenberg-Marquardt by optimistix, one step at a time, so that a fit can be watched, interrupted and resumed."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..errors import SimulationError
from .residuals import Problem

CHI2_TOLERANCE = 1e-3
"""A fit has converged when a step lowers chi^2 by less: that is 0.03 standard errors in any one direction."""
MAX_REJECTED = 20
"""Rejected trials in a row, each with a quarter of the step, after which a fit stands still."""
MAX_ITERATIONS = 100


@dataclasses.dataclass(frozen=True)
class Progress:
    """Where a fit stands after a step; enough to resume it exactly.

    `coordinates` are the accepted unconstrained coordinates, `step_size` is the inverse of the damping, `cost` is
    half the mean squared residual in units of the noise. `failed` counts trial steps whose simulation failed.
    """

    coordinates: tuple[float, ...]
    step_size: float
    iteration: int
    accepted: int
    rejected_in_a_row: int
    failed: int
    cost: float
    converged: bool
    history: tuple[float, ...]
    """Cost after every iteration, the start first."""

    @property
    def finished(self) -> bool:
        """Whether another step would be wasted."""
        return self.converged or self.rejected_in_a_row >= MAX_REJECTED or self.iteration >= MAX_ITERATIONS


def _residuals(coordinates: Float[Array, " parameters"], problem: Problem) -> tuple[Array, None]:
    return problem.residuals(coordinates), None


# A tall, thin Jacobian: QR, never the normal equations, which would square its condition number.
_SOLVER = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8, linear_solver=lx.QR())


@eqx.filter_jit
def _step(problem: Problem, coordinates: Array, state: Any) -> tuple[Array, Any, Array]:
    coordinates, state, _ = _SOLVER.step(_residuals, coordinates, problem, {}, state, frozenset())
    return coordinates, state, 0.5 * jnp.sum(state.f_info.residual**2)


@eqx.filter_jit
def _cost(problem: Problem, coordinates: Array) -> Array:
    return 0.5 * jnp.sum(problem.residuals(coordinates) ** 2)


def _initial_state(problem: Problem, coordinates: Array, step_size: float) -> Any:
    shape = jax.eval_shape(lambda y: _residuals(y, problem)[0], coordinates)
    state = _SOLVER.init(_residuals, coordinates, problem, {}, shape, None, frozenset())
    return eqx.tree_at(lambda s: s.search_state.step_size, state, jnp.asarray(step_size))


def levenberg_marquardt(
    problem: Problem, start: Float[np.ndarray, " parameters"], resume: Progress | None = None
) -> Iterator[Progress]:
    """Minimises the cost of a problem, yielding after every step until it has converged or stands still.

    A trial step whose simulation fails has infinite residuals: it is rejected and the step shortened, like any
    step that does not lower the cost.

    **Arguments:** `start`: unconstrained coordinates; `resume`: the last progress of an interrupted fit.

    **Raises:** `SimulationError` when the start itself can't be simulated.
    """
    if resume is None:
        cost = float(_cost(problem, jnp.asarray(start)))
        resume = Progress(tuple(map(float, start)), 1.0, 0, 0, 0, 0, cost, len(start) == 0, (cost,))
    if not np.isfinite(resume.cost):
        raise SimulationError(
            "the simulation with the start values fails, so there is nothing to fit from; check the start values "
            "under [parameters] and the inputs of the traces"
        )
    yield resume
    coordinates = jnp.asarray(resume.coordinates)
    state = _initial_state(problem, coordinates, resume.step_size)
    if not resume.finished:
        coordinates, state, _ = _step(problem, coordinates, state)  # accepts the start, proposes a first trial
    while not resume.finished:
        resume, coordinates, state = _advance(problem, resume, coordinates, state)
        yield resume


def _advance(
    problem: Problem, before: Progress, coordinates: Array, state: Any
) -> tuple[Progress, Array, Any]:
    trial, accepted_before = state.y_eval, int(state.num_accepted_steps)
    coordinates, state, cost = _step(problem, coordinates, state)
    accepted = int(state.num_accepted_steps) > accepted_before
    failed = not accepted and not np.isfinite(float(_cost(problem, trial)))
    gain = 2 * problem.count * (before.cost - float(cost))
    progress = Progress(
        coordinates=tuple(np.asarray(coordinates).tolist()),
        step_size=float(state.search_state.step_size),
        iteration=before.iteration + 1,
        accepted=before.accepted + accepted,
        rejected_in_a_row=0 if accepted else before.rejected_in_a_row + 1,
        failed=before.failed + failed,
        cost=float(cost),
        converged=accepted and gain < CHI2_TOLERANCE,
        history=(*before.history, float(cost)),
    )
    return progress, coordinates, state
