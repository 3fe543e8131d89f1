"""A sampled controller on a continuous plant."""

import dataclasses
import math
from collections.abc import Set as AbstractSet
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from ..._errors import InputError, is_traced
from ..._types import Scalar, Tree, Values
from ...parts import tabulated
from ...plants import AbstractModel, State
from ...simulation import (
    RESULTS,
    FixedMarch,
    FixedStep,
    Solution,
    check_result,
    choose,
    end_of,
    fixed,
    model_dtype,
    scan_in_blocks,
)
from ...traces import Drive
from .._base import JUDGED, AbstractController, Log, Measurement, Reference, saturate
from .._held import answer, begin
from ..surroundings import Disturbed, Scenario


class ClosedLoop(eqx.Module):
    """What a closed loop returns, at its samples; every array has the shape `(time,)`, and axes of a batch before it.

    `plant` is what [`simulate`][] would return, with the true signals; `measured` is what the sensors showed, the last
    number of which the controller was given where one is none.
    `command` is the duty in percent that it asked for, `duty` what the converter got, held to the next sample, which
    a [`LateDuty`][] makes another one.
    `log` is what the controller logged, and `observes` names what of it the closed loop is judged by.
    """

    plant: Solution
    measured: Measurement
    reference: Reference
    command: Float[Array, "*batch time"]
    duty: Float[Array, "*batch time"]
    log: Log
    observes: frozenset[str] = eqx.field(static=True)

    def observed(self, name: str) -> Values | None:
        """What the controller observed, of its log; `None` for one that does not observe this.

        **Raises:** `InputError` for a name that no controller observes.
        """
        if name not in JUDGED:
            raise InputError(f"a controller observes {_listed(JUDGED)}, but no {name}; use one of these")
        return self.log[name] if name in self.observes else None

    @property
    def time(self) -> Float[Array, "*batch time"]:
        """s"""
        return self.plant.time

    @property
    def position(self) -> Float[Array, "*batch time"]:
        """True position in m."""
        return self.plant.x_d

    @property
    def velocity(self) -> Float[Array, "*batch time"]:
        """True velocity in m/s."""
        return self.plant.v_d

    @property
    def pressure(self) -> Float[Array, "*batch time"]:
        """True chamber pressure in Pa absolute."""
        return self.plant.p_act

    @property
    def error(self) -> Float[Array, "*batch time"]:
        """Reference minus true position in m."""
        return self.reference.position - self.position

    @property
    def result(self) -> RESULTS:
        """Whether the run stayed within the finite numbers."""
        return self.plant.result


class _Sample(eqx.Module):
    state: State
    measured: Measurement
    command: Scalar
    duty: Scalar
    log: Log


def close_loop(
    plant: AbstractModel,
    controller: AbstractController,
    scenario: Scenario,
    duration: float,
    *,
    period: float = 1e-3,
    stepping: FixedStep | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    derivative_memory: float | Scalar = math.inf,
    throw: bool = True,
) -> ClosedLoop:
    """Runs a controller on a plant for `duration` seconds, sampled every `period` seconds.

    At every sample the sensors are read, the controller updates without delay, and its duty, limited to 0 to 100 %, is
    held to the next sample; the scenario's disturbances stand between them. Differentiable with respect to every
    floating leaf of `plant`, `controller` and `scenario`; can be jitted, and vmapped over batches of them. The
    precision is that of the plant's parameters.

    **Arguments:**

    - `plant`: a model that is driven by the duty, e.g. an [`Actuator`][].
    - `duration`: rounded to whole periods.
    - `stepping`: steps of the plant between samples, [`FixedStep`][] by default.
    - `adjoint`: `diffrax.ForwardMode()` by default; `diffrax.RecursiveCheckpointAdjoint()` for reverse mode, whose
      memory beyond what is returned grows with the square root of the number of samples.
    - `derivative_memory`: s; what a sample leaves to the next loses its derivatives with this time constant. Infinite,
      derivatives are exact. Of a loop that sticks and slips, or hunts, exact ones may grow without end and say nothing
      about where a cost falls; then some multiple of the loop's own time constants keeps what matters.
    - `throw`: whether a run that fails raises; when false, look at `result` of the answer.
      A batch wants `throw=False`, or one bad lane raises for all.

    **Raises:** `InputError` for a plant that needs more than a duty, or a period or duration that is not positive; with
    `throw`, `SimulationError` with the advice of `RESULTS` when the run fails (inside of `jit` a `RuntimeError` of
    equinox).
    """
    if plant.needs != ("pwm",):
        raise InputError(
            f"a plant must be driven by the duty alone, but {type(plant).__name__} needs {', '.join(plant.needs)}; "
            "use e.g. Actuator"
        )
    if not is_traced(derivative_memory) and not derivative_memory > 0:
        raise InputError(
            f"derivative_memory must be positive, but it is {derivative_memory} s; use e.g. 1, or infinity"
        )
    if not (0 < period < math.inf and period <= duration < math.inf):
        raise InputError(
            f"period must be positive and at most the duration, but they are {period} s and {duration} s; "
            "use e.g. 0.001 and 10"
        )
    plan = fixed(stepping).plan_intervals(plant, period)
    adjoint = diffrax.ForwardMode() if adjoint is None else adjoint
    kept = jnp.exp(-period / jnp.asarray(derivative_memory, float))
    loop = _close_loop(plant, controller, scenario, round(duration / period), period, plan, adjoint, kept)
    return check_result(loop, loop.result, "the closed loop") if throw else loop


@eqx.filter_jit
def _close_loop(
    plant: AbstractModel,
    controller: AbstractController,
    scenario: Scenario,
    intervals: int,
    period: float,
    plan: FixedMarch,
    adjoint: diffrax.AbstractAdjoint,
    kept: Scalar,
) -> ClosedLoop:
    dtype = model_dtype(plant)
    plant = tabulated(plant)
    controller, scenario = _cast(controller, dtype), _cast(scenario, dtype)
    time = jnp.arange(intervals + 1, dtype=dtype) * period
    drive, disturbed = scenario.drive(time, period), Disturbed(scenario.disturbances)
    reference = scenario.references(time)
    felt = disturbed.felt(time, drive)
    inputs = (time, drive, felt, reference, scenario.sensors.draw(scenario.key, intervals + 1))

    def measure(state: State, drive: Drive, deviates: Array) -> Measurement:
        position, pressure = plant.observe(state, drive)
        assert drive.reservoir is not None, "a scenario has one"
        ambient = plant.air.pressure + drive.ambient_shift
        truth = Measurement(position, pressure, drive.reservoir.start, ambient, drive.turbine.start)
        return scenario.sensors(truth, deviates)

    def sample(carry: Any, inputs: Any) -> tuple[Any, _Sample]:
        (state, memory, (faults, paths)), solved = fade(carry[:3], kept), carry[3]
        time, drive, felt, reference, deviates = inputs
        faults, measured = disturbed.shown(faults, time, measure(state, drive, deviates))
        memory, command, log = answer(controller, memory, measured, reference, period)
        paths, duty = disturbed.arriving(paths, saturate(command), period)
        here = disturbed.altered(plant, time)
        onward, found = plan.advance(here, state, dataclasses.replace(felt, pwm=duty))
        return (onward, memory, (faults, paths), solved & found), _Sample(state, measured, command, duty, log)

    start, first, acting, _, deviates = jax.tree.map(lambda leaf: leaf[0], inputs)
    before = dataclasses.replace(acting, pwm=scenario.duty_before)
    state = disturbed.altered(plant, start).start(scenario.start, before)
    measured = measure(state, first, deviates)
    memories = disturbed.start(measured, scenario.duty_before, period)
    _, shown = disturbed.shown(memories[0], start, measured)
    carry = (state, begin(controller, shown), memories, jnp.asarray(True))
    (*_, solved), run = scan_in_blocks(sample, carry, inputs, adjoint)

    signals = jax.vmap(plant.signals)(run.state, dataclasses.replace(felt, pwm=run.duty))
    result = end_of((run.state, run.command), choose(solved, RESULTS.successful, RESULTS.root_not_found), plant)
    solution = Solution(time, run.state, signals, result)
    return ClosedLoop(solution, run.measured, reference, run.command, run.duty, run.log, _observed(controller, run.log))


def _observed(controller: AbstractController, log: Log) -> frozenset[str]:
    """What a controller observes, if that is what it logs of what closed loops are judged by."""
    logged = JUDGED & set(log)
    if controller.observes != logged:
        raise InputError(
            f"observes of a controller must name what it logs of {_listed(JUDGED)}, but that of "
            f"{type(controller).__name__} names {_listed(controller.observes)}, and it logs {_listed(logged)}; make "
            "them agree"
        )
    return controller.observes


def _listed(names: AbstractSet[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _cast(tree: Tree, dtype: DTypeLike) -> Tree:
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf, tree)


def fade(tree: Tree, kept: Scalar) -> Tree:
    """The same tree; the derivatives of its floating leaves are multiplied by `kept`."""
    return jax.tree.map(lambda leaf: _fade(leaf, kept) if eqx.is_inexact_array(leaf) else leaf, tree)


@jax.custom_jvp
def _fade(leaf: Array, kept: Scalar) -> Array:
    return leaf


@_fade.defjvp
def _(primals, tangents):
    leaf, kept = primals
    return leaf, kept.astype(leaf.dtype) * tangents[0]
