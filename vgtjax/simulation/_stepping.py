"""Time integration: from a start state along the intervals of a drive. The only place where time advances."""

import abc
import math
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .._errors import InputError
from ..plants import AbstractModel, State
from ..traces import Drive
from ._heun import StabilisedHeun


class AbstractStepping(eqx.Module):
    """How time is stepped."""

    @abc.abstractmethod
    def run(
        self,
        model: AbstractModel,
        state: State,
        drive: Drive,
        substeps: int,
        adjoint: diffrax.AbstractAdjoint,
        jumps: Int[Array, " jumps"] | None = None,
    ) -> State:
        """States at the start of every interval of `drive`, beginning with `state`.

        `substeps` is how often fixed steps divide an interval; `jumps` are the intervals at whose start the duty jumps,
        any of them where it is `None`.
        """


class FixedStep(AbstractStepping):
    """Equal steps that divide every interval between samples: the default.

    A duty step falls on an interval's edge, so no step ever straddles a jump; nothing depends on data, so batches
    stay in step. `solver` is a diffrax solver, by default [`StabilisedHeun`][]; an implicit one needs a root finder
    with tolerances of its own, as there is no step size controller to take them from.
    """

    max_step: float = eqx.field(static=True, default=5e-4)
    solver: diffrax.AbstractSolver | None = None

    def __check_init__(self) -> None:
        if not 0 < self.max_step < math.inf:
            raise InputError(f"max_step must be a positive number of seconds, but it is {self.max_step}; use e.g. 5e-4")

    def substeps(self, model: AbstractModel, longest_interval: float) -> int:
        """Steps an interval, such that the longest interval is cut finely enough, also for the model."""
        step = min(self.max_step, model.longest_step)
        return max(1, math.ceil(longest_interval / step * (1 - 1e-9)))

    def advance(self, model: AbstractModel, state: State, drive: Drive, substeps: int, unroll: int = 1) -> State:
        """State at the end of one interval; `unroll` steps are compiled side by side, see `jax.lax.scan`."""
        solver = StabilisedHeun(model.relaxation) if self.solver is None else self.solver
        term = diffrax.ODETerm(model.vector_field)
        step = drive.duration / substeps
        memory = solver.init(term, jnp.zeros_like(step), step, state, drive)

        def one(carry, index):
            y, memory = carry
            begin = index * step
            y, _, _, memory, result = solver.step(term, begin, begin + step, y, drive, memory, made_jump=False)
            # An implicit solver that did not find its root has failed, however finite its answer is.
            solved = result == diffrax.RESULTS.successful
            return (jax.tree.map(lambda leaf: jnp.where(solved, leaf, jnp.nan), y), memory), None

        (state, _), _ = jax.lax.scan(one, (state, memory), jnp.arange(substeps, dtype=step.dtype), unroll=unroll)
        return state

    def run(
        self,
        model: AbstractModel,
        state: State,
        drive: Drive,
        substeps: int,
        adjoint: diffrax.AbstractAdjoint,
        jumps: Int[Array, " jumps"] | None = None,
    ) -> State:
        """See the base class. Reverse mode checkpoints the march over intervals."""

        def interval(y, inputs):
            return self.advance(model, y, inputs, substeps, unroll=UNROLL), y

        return scan_in_blocks(interval, state, drive, adjoint)


def scan_in_blocks(step: Callable[[Any, Any], Any], carry: Any, inputs: Any, adjoint: diffrax.AbstractAdjoint) -> Any:
    """What `jax.lax.scan(step, carry, inputs)` yields, the intervals of a march in blocks of `BLOCK`.

    In reverse mode (`RecursiveCheckpointAdjoint`) only what begins some of the blocks is kept.

    **Raises:** `InputError` for any other adjoint than that, `ForwardMode` and `DirectAdjoint`.
    """
    count = len(jax.tree.leaves(inputs)[0])

    def block(carry, inputs):
        return jax.lax.scan(step, carry, inputs)

    def split(leaf):
        # The last interval of a march has no length: repeated, it moves nothing, and what it yields is cut off.
        padding = [(0, -count % BLOCK)] + [(0, 0)] * (leaf.ndim - 1)
        return jnp.pad(leaf, padding, mode="edge").reshape(-1, BLOCK, *leaf.shape[1:])

    blocks = jax.tree.map(split, inputs)
    match adjoint:
        case diffrax.ForwardMode() | diffrax.DirectAdjoint():
            found = jax.lax.scan(block, carry, blocks)[1]
        case diffrax.RecursiveCheckpointAdjoint(checkpoints=checkpoints):
            found = eqxi.scan(block, carry, blocks, kind="checkpointed", checkpoints=checkpoints)[1]
        case _:
            raise _unsuitable(adjoint)
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:count], found)


BLOCK = 20
"""Intervals that a march takes in an inner loop of their own. Its small buffers stay close: with JAX's plain settings
a 10 s trace of two signals takes two thirds of the time; with native loops it makes no difference."""
UNROLL = 2
"""Steps compiled side by side in a march: the usual two of a millisecond. Saves another tenth with plain settings."""


def _unsuitable(adjoint: diffrax.AbstractAdjoint) -> InputError:
    return InputError(
        f"adjoint must be ForwardMode, DirectAdjoint or RecursiveCheckpointAdjoint of diffrax with fixed steps, "
        f"but it is {type(adjoint).__name__}; use one of these"
    )


class AdaptiveStep(AbstractStepping):
    """Error-controlled steps over the whole trace by `diffrax.diffeqsolve`, told of every jump of the duty.

    The independent check of [`FixedStep`][], which is faster. `atol` is relative to the usual size of each state.
    """

    rtol: float = 1e-6
    atol: float = 1e-8
    solver: diffrax.AbstractSolver = eqx.field(default_factory=diffrax.Tsit5)
    max_steps: int = eqx.field(static=True, default=1_000_000)

    def run(
        self,
        model: AbstractModel,
        state: State,
        drive: Drive,
        substeps: int,
        adjoint: diffrax.AbstractAdjoint,
        jumps: Int[Array, " jumps"] | None = None,
    ) -> State:
        """See the base class."""
        starts = jnp.concatenate([jnp.zeros(1, drive.duration.dtype), jnp.cumsum(drive.duration)[:-1]])
        # A controller's tolerances are one number for all states, so each state counts in its own usual size.
        size = jax.tree.map(jnp.asarray, model.typical_state())

        def vector_field(time, scaled, args):
            inputs, model, size = args
            index = jnp.clip(jnp.searchsorted(starts, time, side="right") - 1, 0)
            here = jax.tree.map(lambda leaf: leaf[index], inputs)
            state = jax.tree.map(jnp.multiply, scaled, size)
            return jax.tree.map(jnp.divide, model.vector_field(time - starts[index], state, here), size)

        controller = diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=self.rtol, atol=self.atol),
            # An empty array of jumps is an error to the controller, which has no such thing as none of them.
            jump_ts=starts[1:-1] if jumps is None else starts[jumps] if len(jumps) else None,
        )
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(vector_field),
            self.solver,
            t0=0.0,
            t1=starts[-1],
            dt0=1e-5,
            y0=jax.tree.map(jnp.divide, state, size),
            args=(drive, model, size),
            saveat=diffrax.SaveAt(ts=starts),
            stepsize_controller=controller,
            adjoint=adjoint,
            max_steps=self.max_steps,
            throw=False,
        )
        failed = solution.result != diffrax.RESULTS.successful
        return jax.tree.map(lambda leaf, s: jnp.where(failed, jnp.nan, leaf * s), solution.ys, size)
