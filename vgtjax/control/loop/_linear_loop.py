"""A closed loop linearised at some of its samples, and cut where the duty enters the plant."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float

from ..._errors import InputError
from ...parts import tabulated
from ...plants import AbstractModel
from ...simulation import FixedMarch, FixedStep
from .._base import AbstractController
from ..surroundings import Scenario, Sensors
from ._loop import close_loop
from ._replay import step_through


class LinearLoop(eqx.Module):
    """Plant and controller from the duty that the plant gets to the duty that the controller answers, in deviations.

    `y_next = transition y + entry u` over one `period` in s, and the answer is `exit y`; `y` is the state of the plant
    and what the controller remembers. With a leading axis each, these are many loops.
    """

    transition: Float[Array | np.ndarray, "*batch states states"]
    entry: Float[Array | np.ndarray, "*batch states"]
    exit: Float[Array | np.ndarray, "*batch states"]
    period: float = eqx.field(static=True)

    def return_ratio(self, rates: Float[np.ndarray, " rates"]) -> Complex[np.ndarray, " rates"]:
        """`L`, which is -1 where the loop is on its limit of stability, at angular frequencies in rad/s."""
        transition, entry, exit_ = (np.asarray(each) for each in (self.transition, self.entry, self.exit))
        points = np.exp(1j * np.asarray(rates) * self.period)
        shifted = points[:, None, None] * np.eye(len(entry)) - transition
        return -np.linalg.solve(shifted, np.broadcast_to(entry[:, None], (len(points), len(entry), 1)))[..., 0] @ exit_

    @property
    def spectral_radius(self) -> float:
        """Largest absolute eigenvalue of the closed loop, whose deviations die away where it is below one; infinite
        about a run that left the finite numbers. What is remembered for good and never changes, as where the stop is,
        is left out: a deviation of it stays, and does not grow."""
        closed = np.asarray(self.transition) + np.outer(self.entry, self.exit)
        if not np.all(np.isfinite(closed)):
            return np.inf
        moves = np.any(closed != np.eye(len(closed)), axis=1)
        return float(np.max(np.abs(np.linalg.eigvals(closed[np.ix_(moves, moves)])), initial=0.0))


def linearise_loop(
    plant: AbstractModel,
    controller: AbstractController,
    scenario: Scenario,
    times: Sequence[float],
    *,
    period: float = 1e-3,
) -> LinearLoop:
    """The loop about where it is at some `times` in s of a run without noise, which are the leading axis.

    Exact derivatives of one sample of plant and controller. A rod that sticks is a spring, one that slides is not, and
    the plunger answers one way: choose times at which they move as the question wants it. The scenario's disturbances
    are left out. Can be vmapped over plants, controllers and scenarios.

    **Raises:** `InputError` for a time before the first sample, and as [`close_loop`][].
    """
    places = [round(time / period) for time in times]
    if not places or min(places) < 0:
        raise InputError(
            f"a loop is linearised at one or more times of a run, but they are {list(times)} s; give times from 0 s on",
            "times",
        )
    quiet = dataclasses.replace(scenario, sensors=Sensors.ideal(), disturbances=())
    run = close_loop(plant, controller, quiet, (max(places) + 1) * period, period=period, throw=False)
    drives = quiet.drive(run.time, period)
    remembered = step_through(controller, run.measured, run.reference, period, lambda before, *_: before.controller)
    about = (run.plant.states, remembered, run.measured, run.reference, drives, run.duty)
    chosen = jax.tree.map(lambda leaf: leaf[np.array(places)], about)
    plan, plant = FixedStep().plan_intervals(plant, period), tabulated(plant)
    return jax.vmap(lambda at: _linearise(plant, controller, plan, at, period))(chosen)


def _linearise(plant: AbstractModel, controller: AbstractController, plan: FixedMarch, at: Any, period: float) -> Any:
    """The loop about one sample."""
    here, memory, measured, reference, drive, duty = at
    state, state_of = ravel_pytree(here)
    floating, rest = eqx.partition(memory, eqx.is_inexact_array)
    remembered, memory_of = ravel_pytree(floating)

    def answer(state: Array, memory: Array) -> tuple[Array, Array]:
        position, pressure = plant.observe(state_of(state), drive)
        shown = dataclasses.replace(measured, position=position, pressure=pressure)
        after, duty, _ = controller.update(eqx.combine(memory_of(memory), rest), shown, reference, period)
        return ravel_pytree(eqx.filter(after, eqx.is_inexact_array))[0], duty

    def advance(state: Array, duty: Array) -> Array:
        return ravel_pytree(plan.advance(plant, state_of(state), dataclasses.replace(drive, pwm=duty))[0])[0]

    (by_state, by_memory), exits = jax.jacfwd(answer, (0, 1))(state, remembered)
    onward, push = jax.jacfwd(advance, (0, 1))(state, duty)
    unmoved = jnp.zeros((state.size, remembered.size))
    transition = jnp.block([[onward, unmoved], [by_state, by_memory]])
    return LinearLoop(transition, jnp.concatenate([push, unmoved[0]]), jnp.concatenate(exits), period)
