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
import numpy as np
from jaxtyping import Array, Bool, Int

from .._errors import InputError, require_positive
from ..plants import AbstractDynamics, AbstractModel, State
from ..traces import Drive, Trace
from ._heun import StabilisedHeun
from ._results import RESULTS, choose, end_of, from_diffrax

Carried = tuple[State, Any]
"""The state, and what the solver remembers from step to step."""
Flag = Bool[Array, ""]


class AbstractMarch(eqx.Module):
    """A plan to step a model along a trace, made by [`AbstractStepping.plan`][]."""

    @abc.abstractmethod
    def __call__(
        self, model: AbstractModel, state: State, drive: Drive, adjoint: diffrax.AbstractAdjoint
    ) -> tuple[State, RESULTS]:
        """States at the start of every interval of `drive`, beginning with `state`, and how the march ended.

        **Raises:** `InputError` for an adjoint that it can't serve.
        """


class AbstractStepping(eqx.Module):
    """How time is stepped."""

    @abc.abstractmethod
    def plan(self, model: AbstractModel, trace: Trace) -> AbstractMarch:
        """The plan for a model along a trace."""


class AbstractFixedStepping(AbstractStepping):
    """Steps that keep to intervals."""

    @abc.abstractmethod
    def plan(self, model: AbstractModel, trace: Trace) -> "FixedMarch":
        """The plan for a model along a trace."""

    @abc.abstractmethod
    def plan_intervals(self, model: AbstractModel, longest_interval: float) -> "FixedMarch":
        """The plan for intervals of at most so many seconds, which can be advanced one by one."""


def fixed(stepping: AbstractStepping | None) -> AbstractFixedStepping:
    """Steps that keep to intervals: these, or [`FixedStep`][] by default.

    **Raises:** `InputError` for steps that don't.
    """
    if stepping is None:
        return FixedStep()
    if not isinstance(stepping, AbstractFixedStepping):
        raise InputError(
            f"exact Jacobians and sampled controllers need fixed steps, but stepping is {type(stepping).__name__}; use "
            "FixedStep(max_step=...)"
        )
    return stepping


class AbstractFixedMarch(AbstractMarch):
    """`substeps` equal steps of a solver over every interval; by default of [`StabilisedHeun`][]."""

    substeps: eqx.AbstractVar[Any]
    solver: eqx.AbstractVar[diffrax.AbstractSolver | None]

    @abc.abstractmethod
    def repeat(self, one: Callable[[Any, Array], Any], carry: Any, count: Any) -> Any:
        """What is carried on by so many steps over an interval, each made by `one` of that and its number."""

    def unrolled(self) -> "AbstractFixedMarch":
        """The same steps for a march, a few of them compiled side by side where their number is known."""
        return self

    def reversible(self) -> "AbstractFixedMarch":
        """The same steps for reverse mode."""
        return self

    def forward(self) -> "AbstractFixedMarch":
        """The same steps where no derivatives are taken back through them."""
        return self

    def begin(self, model: AbstractDynamics, state: State, drive: Drive) -> Carried:
        """The state, and what the solver remembers from step to step, at the start of an interval."""
        step = drive.duration / self.substeps
        term = diffrax.ODETerm(model.vector_field)
        return state, self._solver(model).init(term, jnp.zeros_like(step), step, state, drive)

    def step(self, model: AbstractDynamics, carried: Carried, drive: Drive, number: Array) -> tuple[Carried, Flag]:
        """The same after one of the steps over an interval, and whether the solver has found every root."""
        begin, end, inputs = drive.step(number, self.substeps)
        jumps = drive.knot is not None or drive.pwm_rate is not None  # what a step sees of the duty, the next does not
        term, (state, memory) = diffrax.ODETerm(model.vector_field), carried
        state, _, _, memory, result = self._solver(model).step(term, begin, end, state, inputs, memory, made_jump=jumps)
        return (state, memory), jnp.asarray(result == diffrax.RESULTS.successful)

    def advance(self, model: AbstractDynamics, state: State, drive: Drive) -> tuple[State, Flag]:
        """State at the end of one interval, and whether the solver has found every root that it looked for."""

        def one(carry: tuple[Carried, Flag], number: Array) -> tuple[Carried, Flag]:
            onward, found = self.step(model, carry[0], drive, number)
            return onward, carry[1] & found

        begun = self.begin(model, state, drive), jnp.asarray(True)
        (state, _), solved = self.repeat(one, begun, drive.steps(self.substeps))
        return state, solved

    def _solver(self, model: AbstractDynamics) -> diffrax.AbstractSolver:
        return StabilisedHeun(model.relaxation) if self.solver is None else self.solver

    def __call__(
        self, model: AbstractModel, state: State, drive: Drive, adjoint: diffrax.AbstractAdjoint
    ) -> tuple[State, RESULTS]:
        """See the base class. Reverse mode checkpoints the march over intervals."""
        steps = self.unrolled()

        def interval(carry, inputs):
            y, solved = carry
            onward, found = steps.advance(model, y, inputs)
            return (onward, solved & found), y

        (_, solved), states = scan_in_blocks(interval, (state, jnp.asarray(True)), drive, adjoint)
        return states, end_of(states, choose(solved, RESULTS.successful, RESULTS.root_not_found), model)


class FixedMarch(AbstractFixedMarch):
    """A number of steps that is part of what is compiled, `together` of them side by side (see `jax.lax.scan`)."""

    substeps: int = eqx.field(static=True)
    solver: diffrax.AbstractSolver | None = None
    together: int = eqx.field(static=True, default=1)

    def unrolled(self) -> "FixedMarch":
        """See the base class."""
        return FixedMarch(self.substeps, self.solver, UNROLL)

    def repeat(self, one: Callable[[Any, Array], Any], carry: Any, count: int) -> Any:
        numbers, unroll = jnp.arange(count), min(self.together, count)
        return jax.lax.scan(lambda carry, number: (one(carry, number), None), carry, numbers, unroll=unroll)[0]


class CountedMarch(AbstractFixedMarch):
    """A number of steps that is a number like others, so that records of all rates share what is compiled.

    Not for reverse mode, which must know for how many steps it has room.
    """

    substeps: Int[np.ndarray, ""] | Int[Array, ""]
    solver: diffrax.AbstractSolver | None = None

    def repeat(self, one: Callable[[Any, Array], Any], carry: Any, count: Any) -> Any:
        return jax.lax.fori_loop(0, count, lambda number, carry: one(carry, jnp.asarray(number)), carry)

    def reversible(self) -> "ReversibleMarch":
        """See the base class."""
        room = max(ROOM, 1 << int(self.substeps).bit_length())  # one more where the duty changes on the way
        return ReversibleMarch(self.substeps, self.solver, room)


ROOM = 32
"""Steps an interval that reverse mode has room for at least: records of most rates share its programs."""


class ReversibleMarch(AbstractFixedMarch):
    """A number of steps that is a number like others, `room` at most; reverse mode keeps the states between steps, and
    makes the rest again.

    To keep all that a step computes takes half as long again to compile, and as much longer to run.
    """

    substeps: Int[np.ndarray, ""] | Int[Array, ""]
    solver: diffrax.AbstractSolver | None = None
    room: int = eqx.field(static=True, default=ROOM)

    def repeat(self, one: Callable[[Any, Array], Any], carry: Any, count: Any) -> Any:
        # Around the choice: inside it, what a step reads, tables included, would be kept for each step in the room.
        @jax.checkpoint
        def step(carry: Any, number: Array) -> tuple[Any, None]:
            return jax.lax.cond(number < count, one, lambda carry, _: carry, carry, number), None

        return jax.lax.scan(step, carry, jnp.arange(self.room))[0]

    def forward(self) -> CountedMarch:
        """See the base class."""
        return CountedMarch(self.substeps, self.solver)


class FixedStep(AbstractFixedStepping):
    """Equal steps that divide every interval between samples: the default.

    A duty step falls on an interval's edge, so no step ever straddles a jump; nothing depends on data, so batches
    stay in step. `solver` is a diffrax solver, by default [`StabilisedHeun`][]; an implicit one needs a root finder
    with tolerances of its own, as there is no step size controller to take them from.
    """

    max_step: float = eqx.field(static=True, default=5e-4)
    solver: diffrax.AbstractSolver | None = None

    def __check_init__(self) -> None:
        require_positive("max_step", self.max_step, "number of seconds", "use e.g. 5e-4")

    def plan(self, model: AbstractModel, trace: Trace) -> FixedMarch:
        """Steps such that the longest interval of the trace is cut finely enough."""
        return self.plan_intervals(model, trace.longest_interval)

    def plan_intervals(self, model: AbstractModel, longest_interval: float) -> FixedMarch:
        """Steps such that the longest interval is cut finely enough, also for the model."""
        step = min(self.max_step, model.longest_step)
        return FixedMarch(max(1, math.ceil(longest_interval / step * (1 - 1e-9))), self.solver)


def scan_in_blocks(
    step: Callable[[Any, Any], Any], carry: Any, inputs: Any, adjoint: diffrax.AbstractAdjoint
) -> tuple[Any, Any]:
    """`jax.lax.scan(step, carry, inputs)`, the intervals of a march in blocks of `BLOCK`.

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
            carry, found = jax.lax.scan(block, carry, blocks)
        case diffrax.RecursiveCheckpointAdjoint(checkpoints=checkpoints):
            carry, found = eqxi.scan(block, carry, blocks, kind="checkpointed", checkpoints=checkpoints)
        case _:
            raise InputError(
                "adjoint must be ForwardMode, DirectAdjoint or RecursiveCheckpointAdjoint of diffrax with fixed steps, "
                f"but it is {type(adjoint).__name__}; use one of these"
            )
    return carry, jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:count], found)


BLOCK = 20
"""Intervals that a march takes in an inner loop of their own. Its small buffers stay close: with JAX's plain settings
a 10 s trace of two signals takes two thirds of the time; with native loops it makes no difference."""
UNROLL = 2
"""Steps compiled side by side in a march: the usual two of a millisecond. Saves another tenth with plain settings; in a
closed loop it costs: derivatives with respect to gains take twice as long, and half as long again to compile."""


class AdaptiveMarch(AbstractMarch):
    """Error-controlled steps over a whole trace that end at every jump of the duty.

    `jumps` are the intervals at whose start the duty jumps, filled up with -1 to one of few lengths, so that their
    number hardly ever changes what is compiled.
    """

    rtol: float
    atol: float
    solver: diffrax.AbstractSolver
    max_steps: int = eqx.field(static=True)
    jumps: Int[np.ndarray, " jumps"]

    def __call__(
        self, model: AbstractModel, state: State, drive: Drive, adjoint: diffrax.AbstractAdjoint
    ) -> tuple[State, RESULTS]:
        """See the base class."""
        starts = jnp.concatenate([jnp.zeros(1, drive.duration.dtype), jnp.cumsum(drive.duration)[:-1]])
        # A controller's tolerances are one number for all states, so each state counts in its own usual size.
        size = jax.tree.map(jnp.asarray, model.typical_state())

        def vector_field(time, scaled, args):
            inputs, model, size = args
            index = jnp.clip(jnp.searchsorted(starts, time, side="right") - 1, 0)
            here, elapsed = jax.tree.map(lambda leaf: leaf[index], inputs), time - starts[index]
            state = jax.tree.map(jnp.multiply, scaled, size)
            return jax.tree.map(jnp.divide, model.vector_field(elapsed, state, here.held_at(elapsed)), size)

        # The controller never comes to an infinite time.
        jump_ts = jnp.where(self.jumps < 0, jnp.inf, starts[self.jumps])
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(vector_field),
            self.solver,
            t0=0.0,
            t1=starts[-1],
            dt0=1e-5,
            y0=jax.tree.map(jnp.divide, state, size),
            args=(drive, model, size),
            saveat=diffrax.SaveAt(ts=starts),
            stepsize_controller=diffrax.ClipStepSizeController(
                diffrax.PIDController(rtol=self.rtol, atol=self.atol), jump_ts=jump_ts
            ),
            adjoint=adjoint,
            max_steps=self.max_steps,
            throw=False,
        )
        states = jax.tree.map(jnp.multiply, solution.ys, size)
        return states, end_of(states, from_diffrax(solution.result), model)


FEWEST_JUMPS = 64
"""Up to so many jumps of the duty share what is compiled; beyond, up to each power of two."""


class AdaptiveStep(AbstractStepping):
    """Error-controlled steps over the whole trace by `diffrax.diffeqsolve` that end at every jump of the duty.

    The independent check of [`FixedStep`][], which is faster. `atol` is relative to the usual size of each state.
    """

    rtol: float = 1e-6
    atol: float = 1e-8
    solver: diffrax.AbstractSolver = eqx.field(default_factory=diffrax.Tsit5)
    max_steps: int = eqx.field(static=True, default=1_000_000)

    def plan(self, model: AbstractModel, trace: Trace) -> AdaptiveMarch:
        """Steps that end at every jump of the trace's duty."""
        jumps = trace.jumps()
        # Every step looks at all of them: as many as samples made a simulation four times as long.
        length = max(FEWEST_JUMPS, 2 ** math.ceil(math.log2(max(len(jumps), 1))))
        filled = np.pad(jumps, (0, length - len(jumps)), constant_values=-1)
        return AdaptiveMarch(self.rtol, self.atol, self.solver, self.max_steps, filled)
