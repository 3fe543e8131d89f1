"""A model as functions in C: its start state, a step of the library's integrator, its derivatives, its signals."""

import dataclasses
import functools
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from vgtjax.plants import AbstractModel, State
from vgtjax.simulation import StabilisedHeun
from vgtjax.traces import SIGNALS, Drive, Ramp, Start

from .emit import emit_function
from .entries import Vector, entries_of, path_of, with_values
from .primitives import PRELUDE

FIELDS = {"pwm": "pwm", "p_res": "reservoir", "p_act": "chamber"}
"""Fields of a drive by the signal that they hold."""
ALWAYS = ("duration", "ambient_shift")
"""What a drive has besides its inputs."""
START = tuple(field.name for field in dataclasses.fields(Start) if field.name != "number")
"""What is known of the start state."""
TRUTHS = ("at_rest", "pressure_known", "position_known")
"""Those of it that are true or false."""


@dataclasses.dataclass(frozen=True, eq=False)
class Equations:
    """What of a model becomes C.

    All functions take the parameters' entries `p`, what is known of the start `s`, the inputs over an interval `u`, and
    all but the first the state `x`. `u` is the interval's length, the shift of the atmosphere, and value and rate of
    every input.
    """

    model: AbstractModel

    @property
    def inputs(self) -> tuple[str, ...]:
        """Signals that drive it: as its own trace would have them."""
        return ("pwm", "p_res", "p_trb") if "pwm" in self.model.needs else ("p_act", "p_trb")

    @functools.cached_property
    def entries(self) -> list[str]:
        """Entries of the parameters, in the order of `p`."""
        return entries_of(self.model)

    @functools.cached_property
    def states(self) -> list[str]:
        """States by their places in the model's own state, in the order of `x`."""
        return [path_of(path) for path, _ in self._structure[0]]

    @functools.cached_property
    def signals(self) -> list[str]:
        """Signals that a simulation reports, in the order of its files."""
        first = self.drive(jnp.zeros(len(ALWAYS) + 2 * len(self.inputs)))
        found = jax.eval_shape(lambda: self.model.signals(self.model.start(self._rest(), first), first))
        return [name for name in SIGNALS if name in found and name not in self.inputs]

    def drive(self, u: Vector) -> Drive:
        """Inputs over an interval."""
        ramps = {name: Ramp(u[2 + 2 * i], u[3 + 2 * i]) for i, name in enumerate(self.inputs)}
        turbine = ramps.pop("p_trb")
        held: dict[str, Any] = {
            FIELDS[name]: ramp.start if SIGNALS[name].held else ramp for name, ramp in ramps.items()
        }
        return Drive(duration=u[0], ambient_shift=u[1], turbine=turbine, **held)

    def start(self, p: Vector, s: Vector, u: Vector) -> list[Array]:
        """The start state."""
        start = Start(**{name: s[i] != 0 if name in TRUTHS else s[i] for i, name in enumerate(START)})
        return jax.tree.leaves(with_values(self.model, p).start(start, self.drive(u)))

    def step(self, p: Vector, u: Vector, x: Vector, begin: Array, length: Array) -> list[Array]:
        """The state a step later; `begin` in s counts from the start of the interval."""
        model = with_values(self.model, p)
        term, solver = diffrax.ODETerm(model.vector_field), StabilisedHeun(model.relaxation)
        return jax.tree.leaves(solver.step(term, begin, begin + length, self._state(x), self.drive(u), None, False)[0])

    def derivatives(self, p: Vector, u: Vector, x: Vector) -> list[Array]:
        """The state's derivatives at the start of the interval."""
        return jax.tree.leaves(with_values(self.model, p).vector_field(jnp.zeros(()), self._state(x), self.drive(u)))

    def reports(self, p: Vector, u: Vector, x: Vector) -> list[Array]:
        """The signals at the start of the interval."""
        found = with_values(self.model, p).signals(self._state(x), self.drive(u))
        return [found[name] for name in self.signals]

    def to_c(self) -> str:
        """All four as `vg_start`, `vg_step`, `vg_derivatives` and `vg_reports`."""
        p, u = np.zeros(len(self.entries)), np.zeros(len(ALWAYS) + 2 * len(self.inputs))
        x, s = np.zeros(len(self.states)), np.zeros(len(START))
        functions = (
            emit_function("vg_start", self.start, {"p": p, "s": s, "u": u}),
            emit_function("vg_step", self.step, {"p": p, "u": u, "x": x, "begin": 0.0, "length": 0.0}),
            emit_function("vg_derivatives", self.derivatives, {"p": p, "u": u, "x": x}),
            emit_function("vg_reports", self.reports, {"p": p, "u": u, "x": x}),
        )
        return "\n".join([PRELUDE, *functions])

    def _rest(self) -> Start:
        zero = jnp.zeros(())
        return Start(jnp.asarray(True), zero, jnp.asarray(False), zero, jnp.asarray(False))

    @functools.cached_property
    def _structure(self) -> tuple[list[Any], Any]:
        first = self.drive(jnp.zeros(len(ALWAYS) + 2 * len(self.inputs)))
        return jax.tree_util.tree_flatten_with_path(jax.eval_shape(lambda: self.model.start(self._rest(), first)))

    def _state(self, x: Vector) -> State:
        return jax.tree.unflatten(self._structure[1], [x[i] for i in range(len(self.states))])
