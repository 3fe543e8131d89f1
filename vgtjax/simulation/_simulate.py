"""Simulation of a model along a trace."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._kept import keep_compiled
from ..plants import AbstractModel, State, tabulated_along
from ..traces import Drive, Start, Trace, cast, require
from ._results import RESULTS, check_result
from ._stepping import AbstractMarch, AbstractStepping, FixedStep


class Solution(eqx.Module):
    """What a simulation returns, at the samples of its trace.

    Every entry of `signals` is an attribute too, for instance `solution.x_d`. Of the full actuator these are
    `x_p, x_d, z` in m, `v_p, v_d` in m/s, `T_act` in K, `p_act` in Pa absolute, and `m_dot_in, m_dot_out` in kg/s,
    each of shape `(time,)`. `states` is the model's state as a PyTree of such arrays.
    """

    time: Float[Array, " time"]
    states: State
    signals: dict[str, Float[Array, " time"]]
    result: RESULTS

    def __getattr__(self, name: str) -> Array:
        if name.startswith("_") or name in ("time", "states", "signals", "result"):
            raise AttributeError(name)
        if name not in self.signals:
            raise AttributeError(f"this model has no signal '{name}', only {', '.join(self.signals)}")
        return self.signals[name]


def model_dtype(model: AbstractModel) -> np.dtype:
    """Precision in which a model computes: that of its parameters."""
    return np.result_type(*[leaf.dtype for leaf in jax.tree.leaves(model) if eqx.is_inexact_array(leaf)])


def simulate(
    model: AbstractModel,
    trace: Trace,
    *,
    stepping: AbstractStepping | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    throw: bool = True,
) -> Solution:
    """Simulates a model along a trace, from the start state that follows from the trace.

    Differentiable with respect to every array leaf of `model`, can be jitted, and vmapped over batches of models.
    The precision is that of the model's parameters.

    **Arguments:**

    - `model`: e.g. an [`Actuator`][].
    - `trace`: gives inputs and sample times.
    - `stepping`: [`FixedStep`][] by default; tighten with `FixedStep(max_step=1e-4)`.
    - `adjoint`: `diffrax.ForwardMode()` by default; `diffrax.RecursiveCheckpointAdjoint()` for reverse mode.
    - `throw`: whether a simulation that fails raises; when false, look at `solution.result`.
      A batch under `jax.vmap` wants `throw=False`, or one bad lane raises for all.

    Under `jax.jit`, close over the trace: `jax.jit(lambda model: simulate(model, trace).x_d)`.

    **Raises:** `InputError` when the trace lacks a column that the model needs; with `throw`, `SimulationError` with
    the advice of [`RESULTS`][] when the simulation fails (inside of `jit` a `RuntimeError` of equinox).
    """
    require(trace, model.needs)
    stepping = FixedStep() if stepping is None else stepping
    adjoint = diffrax.ForwardMode() if adjoint is None else adjoint
    dtype = model_dtype(model)
    drive, start = cast(trace.drive(), dtype), cast(trace.start(), dtype)
    solution = _simulate(model, drive, start, trace.time.astype(dtype), stepping.plan(model, trace), adjoint)
    return check_result(solution, solution.result, f"the simulation of trace '{trace.name}'") if throw else solution


@keep_compiled
def _simulate(
    model: AbstractModel,
    drive: Drive,
    start: Start,
    time: Float[ArrayLike, " time"],
    plan: AbstractMarch,
    adjoint: diffrax.AbstractAdjoint,
) -> Solution:
    model = tabulated_along(model, drive)
    states, result = march(model, drive, start, plan, adjoint)
    return Solution(jnp.asarray(time), states, jax.vmap(model.signals)(states, drive), result)


def march(
    model: AbstractModel,
    drive: Drive,
    start: Start,
    plan: AbstractMarch,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> tuple[State, RESULTS]:
    """States at the start of every interval of `drive` (leading axis of each leaf), and how the march ended.

    `adjoint` is `diffrax.ForwardMode()` by default.
    """
    first = jax.tree.map(lambda leaf: leaf[0], drive)
    model = tabulated_along(model, drive)
    return plan(model, model.start(start, first), drive, diffrax.ForwardMode() if adjoint is None else adjoint)
