"""Many closed loops compiled as one function, with derivatives with respect to the gains."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..control import AbstractController, ClosedLoop, Scenario, close_loop, tracking_peak, tracking_rms
from ..parameters import Selection, Transform
from ..plants import AbstractModel
from ..simulation import RESULTS
from ._objective import Objective

Figures = tuple[Array, Array, Array, Array]
"""Terms, RMS and peak error, and whether the run is good, of one closed loop."""


class Timing(NamedTuple):
    """Seconds."""

    duration: float
    period: float


class Row(NamedTuple):
    """One closed loop: a plant, what it is put through, the gains' coordinates, and seconds that derivatives last."""

    plant: AbstractModel
    scenario: Scenario
    coordinates: Float[Array, " gains"]
    memory: Float[Array, ""]


@eqx.filter_jit
def evaluate(
    controller: AbstractController,
    selection: Selection,
    transform: Transform,
    objective: Objective,
    timing: Timing,
    rows: Row,
) -> tuple[Figures]:
    """Figures of every row; every array in and out has a leading axis of them."""
    fixed = (controller, selection, transform, objective, timing)
    return (jax.vmap(lambda row: _outcome(*fixed, row)[1])(rows),)


@eqx.filter_jit
def linearise(
    controller: AbstractController,
    selection: Selection,
    transform: Transform,
    objective: Objective,
    timing: Timing,
    rows: Row,
) -> tuple[Figures, Float[Array, "rows gains"], Float[Array, "rows gains gains"]]:
    """The same, with gradient of the cost and twice the Gram matrix of the residuals' derivatives.

    Every direction is pushed through all rows at once, so that rows lie next to each other in memory, which is faster
    on a CPU than the Jacobian of each row.
    """
    fixed = (controller, selection, transform, objective, timing)

    def all_rows(coordinates: Array) -> tuple[Array, Figures]:
        return jax.vmap(lambda row: _outcome(*fixed, row))(rows._replace(coordinates=coordinates))

    def push(direction: Array) -> tuple[Array, Array, Figures]:
        along = jnp.broadcast_to(direction, rows.coordinates.shape)
        return jax.jvp(all_rows, (rows.coordinates,), (along,), has_aux=True)

    directions = jnp.eye(rows.coordinates.shape[1], dtype=rows.coordinates.dtype)
    found, columns, figures = jax.vmap(push, out_axes=(None, 0, None))(directions)
    slopes = 2 * jnp.einsum("grt,rt->rg", columns, found)
    return figures, slopes, 2 * jnp.einsum("grt,hrt->rgh", columns, columns)


@eqx.filter_jit
def simulate(controller: AbstractController, timing: Timing, rows: Row) -> ClosedLoop:
    """Every row as a run."""
    return jax.vmap(lambda row: _run(controller, row, timing))(rows)


def _run(controller: AbstractController, row: Row, timing: Timing) -> ClosedLoop:
    return close_loop(
        row.plant,
        controller,
        row.scenario,
        timing.duration,
        period=timing.period,
        derivative_memory=row.memory,
        throw=False,
    )


def _outcome(
    controller: AbstractController,
    selection: Selection,
    transform: Transform,
    objective: Objective,
    timing: Timing,
    row: Row,
) -> tuple[Array, Figures]:
    """Residuals of one row in one array, and its figures."""
    run = _run(selection.unpack(controller, transform.to_physical(row.coordinates)), row, timing)
    residuals, settled = objective.residuals(run), objective.settled
    rms, peak = tracking_rms(run, settled), tracking_peak(run, settled)
    return residuals.ravel(), (jnp.sum(residuals**2, 1), rms, peak, run.result == RESULTS.successful)
