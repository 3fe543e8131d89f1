"""Many closed loops compiled as one function, with derivatives by the gains."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..control import AbstractController, ClosedLoop, Scenario, close_loop, tracking_peak, tracking_rms
from ..model import AbstractModel
from ..parameters import Selection
from ..simulate import RESULTS
from ..transforms import Transform
from .objective import Objective

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

    def one(row: Row) -> Figures:
        tuned = selection.unpack(controller, transform.to_physical(row.coordinates))
        return _figures(_run(tuned, row, timing), objective)[1]

    return (jax.vmap(one)(rows),)


@eqx.filter_jit
def linearise(
    controller: AbstractController,
    selection: Selection,
    transform: Transform,
    objective: Objective,
    timing: Timing,
    rows: Row,
) -> tuple[Figures, Float[Array, "rows gains"], Float[Array, "rows gains gains"]]:
    """The same, with gradient of the cost and twice the Gram matrix of the residuals' derivatives."""

    def one(row: Row) -> tuple[Figures, Array, Array]:
        def residuals(at: Array) -> tuple[Array, tuple[Array, Figures]]:
            tuned = selection.unpack(controller, transform.to_physical(at))
            found, figures = _figures(_run(tuned, row, timing), objective)
            return found, (found, figures)

        columns, (found, figures) = jax.jacfwd(residuals, has_aux=True)(row.coordinates)
        columns = columns.reshape(-1, columns.shape[-1])
        return figures, 2 * columns.T @ found.ravel(), 2 * columns.T @ columns

    return jax.vmap(one)(rows)


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


def _figures(run: ClosedLoop, objective: Objective) -> tuple[Array, Figures]:
    residuals, settled = objective.residuals(run), objective.settled
    rms, peak = tracking_rms(run, settled), tracking_peak(run, settled)
    return residuals, (jnp.sum(residuals**2, 1), rms, peak, run.result == RESULTS.successful)
