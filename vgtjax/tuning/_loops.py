"""Many closed loops compiled as one function, with derivatives with respect to the gains."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..control import (
    AbstractController,
    ClosedLoop,
    Scenario,
    close_loop,
    pressure_peak,
    sliding_share,
    tracking_peak,
    tracking_rms,
)
from ..parameters import Selection, Transform
from ..plants import AbstractModel
from ..simulation import RESULTS
from ._objective import Objective

Figures = tuple[Array, Array, Array, Array, Array, RESULTS]
"""Of one closed loop: terms, RMS and peak error, peak error of the observed pressure, share of samples at which an
observer slides, and how its run ended."""
MEASURES = (tracking_rms, tracking_peak, pressure_peak, sliding_share)


class Timing(NamedTuple):
    """Seconds."""

    duration: float
    period: float


class Lane(NamedTuple):
    """One closed loop: a plant, what it is put through, the gains' coordinates, and seconds that derivatives last."""

    plant: AbstractModel
    scenario: Scenario
    coordinates: Float[Array | np.ndarray, " gains"]
    memory: Float[Array | np.ndarray, ""]


class Shared(NamedTuple):
    """What all closed loops of a call have in common."""

    controller: AbstractController
    selection: Selection
    transform: Transform
    objective: Objective
    timing: Timing


@eqx.filter_jit
def evaluate(shared: Shared, lanes: Lane) -> tuple[Figures]:
    """Figures of every lane; every array in and out has a leading axis of them."""
    return (jax.vmap(lambda lane: _outcome(shared, lane)[1])(lanes),)


@eqx.filter_jit
def linearise(
    shared: Shared, lanes: Lane
) -> tuple[Figures, Float[Array, "lanes gains"], Float[Array, "lanes gains gains"]]:
    """The same, with gradient of the cost and twice the Gram matrix of the residuals' derivatives.

    Every direction is pushed through all lanes at once, so that they lie next to each other in memory, which is faster
    on a CPU than the Jacobian of each lane.
    """

    def all_lanes(coordinates: Array) -> tuple[Array, Figures]:
        return jax.vmap(lambda lane: _outcome(shared, lane))(lanes._replace(coordinates=coordinates))

    def push(direction: Array) -> tuple[Array, Array, Figures]:
        along = jnp.broadcast_to(direction, lanes.coordinates.shape)
        return jax.jvp(all_lanes, (lanes.coordinates,), (along,), has_aux=True)

    directions = jnp.eye(lanes.coordinates.shape[1], dtype=lanes.coordinates.dtype)
    found, columns, figures = jax.vmap(push, out_axes=(None, 0, None))(directions)
    slopes = 2 * jnp.einsum("grt,rt->rg", columns, found)
    return figures, slopes, 2 * jnp.einsum("grt,hrt->rgh", columns, columns)


@eqx.filter_jit
def simulate(controller: AbstractController, timing: Timing, lanes: Lane) -> ClosedLoop:
    """Every lane as a run."""
    return jax.vmap(lambda lane: _run(controller, lane, timing))(lanes)


def _run(controller: AbstractController, lane: Lane, timing: Timing) -> ClosedLoop:
    plant, scenario, (duration, period) = lane.plant, lane.scenario, timing
    return close_loop(plant, controller, scenario, duration, period=period, derivative_memory=lane.memory, throw=False)


def _outcome(shared: Shared, lane: Lane) -> tuple[Array, Figures]:
    """Residuals of one lane in one array, and its figures."""
    tuned = shared.selection.unpack(shared.controller, shared.transform.to_physical(lane.coordinates))
    run = _run(tuned, lane, shared.timing)
    residuals, settled = shared.objective.residuals(run), shared.objective.settled
    measured = (measure(run, settled) for measure in MEASURES)
    return residuals.ravel(), (jnp.sum(residuals**2, 1), *measured, run.result)
