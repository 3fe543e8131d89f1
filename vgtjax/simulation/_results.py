"""How a simulation ended."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from .._errors import SimulationError, is_traced
from .._types import Tree
from ..parts import lost_points
from ..plants import AbstractModel, State, least_volume


class RESULTS(eqx.Enumeration):
    """How a simulation ended; each member is the advice that goes with it."""

    successful = ""
    diverged = "The simulation left the finite numbers: check that the parameters are physical, then lower max_step."
    max_steps_reached = "The solver took max_steps steps before the end: raise max_steps, or loosen rtol and atol."
    root_not_found = "The implicit solver did not find the root of a step: lower max_step, or loosen its root finder."
    unphysical = "The diaphragm swallows the chamber: enlarge chamber.volume, or correct diaphragm.area or travel."
    """Whether or not the rod gets that far."""
    not_periodic = "No cycle repeats itself: check that engine and operating point are physical, then raise substeps."
    """Of an engine, whose exhaust pulsates."""
    no_steady_flow = "There is no steady flow through the nozzle: check its geometry and its gas, or vary them less."
    """Of a turbine that a fit or a population varies; one that is built says so at once."""
    no_number = "What the sensors would see left the finite numbers: check what is known of them."
    """Of a simulation that did not fail itself."""


def choose(condition: Any, one: Any, other: Any) -> RESULTS:
    """`one` where a condition holds, and else `other`."""
    return RESULTS.where(condition, one, other)


def end_of(states: State, result: RESULTS, model: Any = None) -> RESULTS:
    """`result`, or that the states of a solve without other fault have left the finite numbers; of a model, why."""
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(states)]))
    return blame(model, choose((result == RESULTS.successful) & ~finite, RESULTS.diverged, result))


def blame(model: Any, result: RESULTS) -> RESULTS:
    """`result`, or of a failure what tables of the model have lost before; of an actuator that can't exist always
    that."""
    lost = lost_points(model)
    if lost is not None:
        result = choose((result != RESULTS.successful) & lost, RESULTS.no_steady_flow, result)
    left = least_volume(model) if isinstance(model, AbstractModel) else None
    return result if left is None else choose(left <= 0, RESULTS.unphysical, result)


def from_diffrax(result: diffrax.RESULTS) -> RESULTS:
    """The cause that a solver of diffrax names."""
    ours = choose(result == diffrax.RESULTS.successful, RESULTS.successful, RESULTS.diverged)
    ours = choose(result == diffrax.RESULTS.max_steps_reached, RESULTS.max_steps_reached, ours)
    roots = (
        diffrax.RESULTS.nonlinear_divergence,
        diffrax.RESULTS.nonlinear_max_steps_reached,
        diffrax.RESULTS.max_steps_rejected,
    )
    for root in roots:
        ours = choose(result == root, RESULTS.root_not_found, ours)
    return ours


def first_failure(result: RESULTS) -> str:
    """The advice that goes with the first of several ends, or the only one, that failed; empty where none did."""
    # On the host: a search asks this of every trial, and comparisons of JAX take longer than looking at a few numbers.
    ended = jax.tree.map(np.ravel, result)
    failed = np.flatnonzero(jax.tree.leaves(ended)[0] != jax.tree.leaves(RESULTS.successful)[0])
    if not len(failed):
        return ""
    first = jax.tree.map(lambda value: jnp.asarray(value[failed[0]]), ended)
    return RESULTS[first]  # type: ignore[misc]  # mypy: of the metaclass


class HasEnds:
    """Something about several runs, whose `result` says of each how it ended."""

    result: RESULTS

    @property
    def failed(self) -> Bool[np.ndarray, " runs"]:
        """Runs that failed."""
        return np.asarray(self.result != RESULTS.successful)

    @property
    def failure(self) -> str:
        """The advice that goes with the first run that failed; empty where none did."""
        return first_failure(self.result)


def check_result(answer: Tree, result: RESULTS, what: str = "the simulation") -> Tree:
    """`answer`, if it may be used.

    **Raises:** `SimulationError` otherwise; inside of `jit`, where the result is not known yet, a `RuntimeError` of
    equinox with the same advice when the compiled function runs.
    """
    if is_traced(result):
        return result.error_if(answer, result != RESULTS.successful)
    if result != RESULTS.successful:
        raise SimulationError(f"{what} failed: {first_failure(result)}")
    return answer
