"""Closed loops run and judged: each one, and many compiled as one function, with derivatives with respect to gains."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._types import Scalar
from ..control import (
    AbstractController,
    ClosedLoop,
    Scenario,
    chatter,
    close_loop,
    effort,
    pressure_peak,
    pressure_rms,
    sliding_share,
    tracking_peak,
    tracking_rms,
)
from ..parameters import Selection, Transform
from ..plants import AbstractModel
from ..simulation import RESULTS, HasEnds
from ._cases import Cases, stack_trees
from ._objective import Objective

LANES = 64
"""Closed loops that run side by side; memory grows with them, their duration, and the number of gains."""
MEASURES = {
    "rms": tracking_rms,
    "peak": tracking_peak,
    "pressure_rms": pressure_rms,
    "pressure_peak": pressure_peak,
    "sliding": sliding_share,
    "effort": effort,
    "chatter": chatter,
}
"""By the name that each has among [`Figures`][]."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Figures(HasEnds):
    """What closed loops were worth, from some time on.

    `rms` and `peak` of the true error are in m, `pressure_rms` and `pressure_peak` of the observed pressure in Pa (NaN
    where none is observed), `effort` and `chatter` in percent of duty, as [`effort`][] and [`chatter`][] have them;
    `sliding` is the share of samples at which the observer slides as [`sliding_share`][] has it, NaN without such an
    observer. `result` says of each run how it ended; figures of one that failed are NaN.
    """

    rms: Float[np.ndarray, " cases"]
    peak: Float[np.ndarray, " cases"]
    pressure_rms: Float[np.ndarray, " cases"]
    pressure_peak: Float[np.ndarray, " cases"]
    sliding: Float[np.ndarray, " cases"]
    effort: Float[np.ndarray, " cases"]
    chatter: Float[np.ndarray, " cases"]
    result: RESULTS


class Timing(NamedTuple):
    """Seconds."""

    duration: float
    period: float


LoopParts = tuple[AbstractController, AbstractModel, Scenario]
"""One closed loop, or many of them with a leading axis."""


def run_loop(row: LoopParts, timing: Timing, memory: float | Scalar = math.inf) -> ClosedLoop:
    """One closed loop, whose derivatives last for `memory` seconds."""
    (controller, plant, scenario), (duration, period) = row, timing
    return close_loop(plant, controller, scenario, duration, period=period, derivative_memory=memory, throw=False)


def figures_of(run: ClosedLoop, settled: float) -> dict[str, Any]:
    """Its [`Figures`][] by name, from `settled` seconds on."""
    figures = {name: _unless_failed(run, measure(run, settled)) for name, measure in MEASURES.items()}
    return figures | {"result": run.result}


def _unless_failed(run: ClosedLoop, figure: Array) -> Array:
    return jnp.where(run.result == RESULTS.successful, figure, jnp.nan)


def rows_of(
    controllers: AbstractController | Mapping[str, AbstractController], cases: Cases
) -> Callable[[np.ndarray], LoopParts]:
    """Some of the cases, by their places, each with its controller: one for all, or that of each plant by its name.

    **Raises:** `InputError` for a plant that has no controller, or controllers of other structures.
    """
    given = controllers if isinstance(controllers, Mapping) else {label.plant: controllers for label in cases.labels}
    missing = [label.plant for label in cases.labels if label.plant not in given]
    if missing:
        raise InputError(f"every plant needs a controller, but '{missing[0]}' has none; give it one")
    stacked = stack_trees([given[label.plant] for label in cases.labels], "controllers")

    def at(places: np.ndarray) -> LoopParts:
        chosen = cases.take(places.tolist())
        return jax.tree.map(lambda leaf: leaf[places], stacked), chosen.plants, chosen.scenarios

    return at


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
def evaluate_lanes(shared: Shared, lanes: Lane) -> tuple[dict[str, Any]]:
    """Figures and `terms` of every lane; every array in and out has a leading axis of them."""
    return (jax.vmap(lambda lane: _outcome(shared, lane)[1])(lanes),)


@eqx.filter_jit
def linearise_lanes(
    shared: Shared, lanes: Lane
) -> tuple[dict[str, Any], Float[Array, "lanes gains"], Float[Array, "lanes gains gains"]]:
    """The same, with gradient of the cost and twice the Gram matrix of the residuals' derivatives.

    Every direction is pushed through all lanes at once, so that they lie next to each other in memory, which is faster
    on a CPU than the Jacobian of each lane.
    """

    def all_lanes(coordinates: Array) -> tuple[Array, dict[str, Any]]:
        return jax.vmap(lambda lane: _outcome(shared, lane))(lanes._replace(coordinates=coordinates))

    def push(direction: Array) -> tuple[Array, Array, dict[str, Any]]:
        along = jnp.broadcast_to(direction, lanes.coordinates.shape)
        return jax.jvp(all_lanes, (lanes.coordinates,), (along,), has_aux=True)

    directions = jnp.eye(lanes.coordinates.shape[1], dtype=lanes.coordinates.dtype)
    found, columns, figures = jax.vmap(push, out_axes=(None, 0, None))(directions)
    slopes = 2 * jnp.einsum("grt,rt->rg", columns, found)
    return figures, slopes, 2 * jnp.einsum("grt,hrt->rgh", columns, columns)


@eqx.filter_jit
def simulate_lanes(
    controller: AbstractController, plants: AbstractModel, scenarios: Scenario, timing: Timing
) -> ClosedLoop:
    """Every plant along its scenario as a run."""
    return jax.vmap(lambda plant, scenario: run_loop((controller, plant, scenario), timing))(plants, scenarios)


def _outcome(shared: Shared, lane: Lane) -> tuple[Array, dict[str, Any]]:
    """Residuals of one lane in one array, and its figures."""
    tuned = shared.selection.unpack(shared.controller, shared.transform.to_physical(lane.coordinates))
    run = run_loop((tuned, lane.plant, lane.scenario), shared.timing, lane.memory)
    residuals, figures = shared.objective.residuals(run), figures_of(run, shared.objective.settled)
    return residuals.ravel(), figures | {"terms": _unless_failed(run, jnp.sum(residuals**2, 1))}
