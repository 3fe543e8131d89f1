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

Inputs = tuple[AbstractModel, Scenario]
"""A plant and what it is put through."""


class Timing(NamedTuple):
    """Seconds."""

    duration: float
    period: float
    memory: Array
    """Of derivatives."""


@eqx.filter_jit
def evaluate(
    controller: AbstractController,
    selection: Selection,
    transform: Transform,
    objective: Objective,
    timing: Timing,
    inputs: Inputs,
    coordinates: Array,
) -> tuple[Figures]:
    """Figures of every case, each with a leading axis of them."""
    tuned = selection.unpack(controller, transform.to_physical(coordinates))

    def one(case: Inputs) -> Figures:
        return _figures(_run(tuned, case, timing), objective)[1]

    return (jax.vmap(one)(inputs),)


@eqx.filter_jit
def linearise(
    controller: AbstractController,
    selection: Selection,
    transform: Transform,
    objective: Objective,
    timing: Timing,
    inputs: Inputs,
    coordinates: Array,
) -> tuple[Figures, Float[Array, "cases gains"], Float[Array, "cases gains gains"]]:
    """The same, with gradient of the cost and twice the Gram matrix of the residuals' derivatives."""

    def one(case: Inputs) -> tuple[Figures, Array, Array]:
        def residuals(at: Array) -> tuple[Array, tuple[Array, Figures]]:
            tuned = selection.unpack(controller, transform.to_physical(at))
            found, figures = _figures(_run(tuned, case, timing), objective)
            return found, (found, figures)

        columns, (found, figures) = jax.jacfwd(residuals, has_aux=True)(coordinates)
        columns = columns.reshape(-1, columns.shape[-1])
        return figures, 2 * columns.T @ found.ravel(), 2 * columns.T @ columns

    return jax.vmap(one)(inputs)


@eqx.filter_jit
def simulate(controller: AbstractController, timing: Timing, inputs: Inputs) -> ClosedLoop:
    """Every case as a run."""
    return jax.vmap(lambda case: _run(controller, case, timing))(inputs)


def _run(controller: AbstractController, case: Inputs, timing: Timing) -> ClosedLoop:
    plant, scenario = case
    return close_loop(
        plant,
        controller,
        scenario,
        timing.duration,
        period=timing.period,
        derivative_memory=timing.memory,
        throw=False,
    )


def _figures(run: ClosedLoop, objective: Objective) -> tuple[Array, Figures]:
    residuals, settled = objective.residuals(run), objective.settled
    rms, peak = tracking_rms(run, settled), tracking_peak(run, settled)
    return residuals, (jnp.sum(residuals**2, 1), rms, peak, run.result == RESULTS.successful)
