"""A closed loop linearised at one of its samples, and cut where the duty enters the plant."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float

from .._errors import InputError
from ..parts import tabulated
from ..plants import AbstractModel
from ..simulation import FixedStep
from ._base import AbstractController, Measurement, Memory
from ._loop import ClosedLoop, close_loop
from ._scenario import Scenario
from ._sensors import Sensors


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
        """Largest absolute eigenvalue of the closed loop, whose deviations die away where it is below one."""
        closed = np.asarray(self.transition) + np.outer(self.entry, self.exit)
        return float(np.max(np.abs(np.linalg.eigvals(closed))))


def linearise_loop(
    plant: AbstractModel, controller: AbstractController, scenario: Scenario, time: float, *, period: float = 1e-3
) -> LinearLoop:
    """The loop about where it is `time` seconds after the start of a run without noise.

    Exact derivatives of one sample of plant and controller. A rod that sticks is a spring, one that slides is not, and
    the plunger answers one way: choose a time at which it moves as the question wants it. The scenario's disturbances
    are left out. Can be vmapped over plants, controllers and scenarios.

    **Raises:** `InputError` for a time that is shorter than a period, and as [`close_loop`][].
    """
    samples = round(time / period)
    if samples < 1:
        raise InputError(
            f"a loop is linearised at least one period after its start, but time is {time} s and period {period} s; "
            "choose a later time",
            "time",
        )
    quiet = dataclasses.replace(scenario, sensors=Sensors.ideal(), disturbances=())
    run = close_loop(plant, controller, quiet, samples * period, period=period, throw=False)
    here, state_of = ravel_pytree(jax.tree.map(lambda leaf: leaf[-1], run.plant.states))
    floating, rest = eqx.partition(_remembered(controller, run, period), eqx.is_inexact_array)
    remembered, memory_of = ravel_pytree(floating)
    reference = jax.tree.map(lambda leaf: leaf[-1], run.reference)
    drive = jax.tree.map(lambda leaf: leaf[-2], quiet.drive(run.time, period))  # the last one has no duration
    plan, plant = FixedStep().plan_intervals(plant, period), tabulated(plant)

    def answer(state: Array, memory: Array) -> tuple[Array, Array]:
        position, pressure = plant.observe(state_of(state), drive)
        truth = Measurement(position, pressure, *_surroundings(run))
        after, duty, _ = controller.update(eqx.combine(memory_of(memory), rest), truth, reference, period)
        return ravel_pytree(eqx.filter(after, eqx.is_inexact_array))[0], duty

    def advance(state: Array, duty: Array) -> Array:
        return ravel_pytree(plan.advance(plant, state_of(state), dataclasses.replace(drive, pwm=duty))[0])[0]

    (by_state, by_memory), exits = jax.jacfwd(answer, (0, 1))(here, remembered)
    onward, push = jax.jacfwd(advance, (0, 1))(here, run.duty[-1])
    unmoved = jnp.zeros((here.size, remembered.size))
    transition = jnp.block([[onward, unmoved], [by_state, by_memory]])
    return LinearLoop(transition, jnp.concatenate([push, unmoved[0]]), jnp.concatenate(exits), period)


def _remembered(controller: AbstractController, run: ClosedLoop, period: float) -> Memory:
    """What the controller remembers before the last sample of a run."""
    first = jax.tree.map(lambda leaf: leaf[0], run.measured)
    before = jax.tree.map(lambda leaf: leaf[:-1], (run.measured, run.reference))
    start = controller.initial_state(first, period)
    return jax.lax.scan(lambda memory, given: (controller.update(memory, *given, period)[0], None), start, before)[0]


def _surroundings(run: ClosedLoop) -> tuple[Array, Array, Array]:
    """Pressures of reservoir, atmosphere and turbine at the last sample."""
    measured = run.measured
    return measured.reservoir[-1], measured.ambient[-1], measured.turbine[-1]
