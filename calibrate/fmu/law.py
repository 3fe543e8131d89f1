"""A controller as functions in C: what it remembers before the first sample, and one sample of it."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from vgtjax.control import AbstractController, Measurement, Reference, saturate
from vgtjax.traces import ASSUMED_RESERVOIR, STANDARD_ATMOSPHERE

from .emit import emit_function, needs
from .entries import Vector, entries_of, path_of, with_values
from .primitives import PRELUDE

MEASURED = {"x_d": "position", "p_act": "pressure", "p_res": "reservoir", "atmosphere": "ambient", "p_trb": "turbine"}
"""Fields of a measurement by the plant's name for each."""
WANTED = {f"reference.{field.name}": field.name for field in dataclasses.fields(Reference)}
"""Fields of a reference by the input that has each."""

FIRST = {"p_res": ASSUMED_RESERVOIR, "p_act": STANDARD_ATMOSPHERE, "atmosphere": STANDARD_ATMOSPHERE}
"""Inputs that don't begin at zero."""


@dataclasses.dataclass(frozen=True, eq=False)
class Law:
    """What of a controller becomes C.

    Both functions take the parameters' entries `p` and the inputs at a sample `u`, `update` also what is remembered,
    `x`: what the controller remembers, and the last number that each measured input has shown, which stands for one
    that is none. The sampling time `period` in s is a part of the law.
    """

    controller: AbstractController
    period: float

    @functools.cached_property
    def inputs(self) -> tuple[str, ...]:
        """Of measurement and reference what the controller looks at."""
        names = (*MEASURED, *WANTED)
        memory = [jnp.zeros(shape.shape, shape.dtype) for _, shape in self._structure[0]]

        def everything(*values: Array) -> list[Array]:
            given = dict(zip(names, values, strict=False))
            outputs, after = self._update(self.controller, given, values[len(names) :])
            return [*outputs, *after, *self._start(self.controller, given)]

        used = needs(everything, [*[jnp.zeros(())] * len(names), *memory])
        return tuple(name for name, is_used in zip(names, used, strict=False) if is_used)

    @functools.cached_property
    def entries(self) -> list[str]:
        """Entries of gains and beliefs, in the order of `p`."""
        return entries_of(self.controller)

    @functools.cached_property
    def memory(self) -> list[str]:
        """What is remembered by its places in the controller's own state, and inputs, in the order of `x`."""
        names = [(path_of(path), shape) for path, shape in self._structure[0]]
        own = [name if not shape.shape else f"{name}[{i}]" for name, shape in names for i in range(shape.size)]
        return own + [f"last.{name}" for name in self.held]

    @functools.cached_property
    def held(self) -> tuple[str, ...]:
        """Inputs whose last number stands for one that is none."""
        return () if self.controller.sees_gaps else tuple(name for name in self.inputs if name in MEASURED)

    @functools.cached_property
    def outputs(self) -> list[str]:
        """The duty that the converter gets, the one that was asked for, and what is logged."""
        return ["pwm", "command", *(f"log.{name}" for name in self._logged)]

    def start(self, p: Vector, u: Vector) -> list[Array]:
        """What is remembered before the first sample."""
        given = self._named(u, [jnp.asarray(FIRST.get(name, 0.0)) for name in self.held])
        return [*_flat(self._start(with_values(self.controller, p), given)), *(given[name] for name in self.held)]

    def update(self, p: Vector, u: Vector, x: Vector) -> list[Array]:
        """The outputs of a sample, and what is remembered after it."""
        memory, place = [], 0
        for _, shape in self._structure[0]:
            memory.append(x[place : place + shape.size].reshape(shape.shape).astype(shape.dtype))
            place += shape.size
        given = self._named(u, [x[place + i] for i in range(len(self.held))])
        outputs, remembered = self._update(with_values(self.controller, p), given, memory)
        return [*outputs, *_flat(remembered), *(given[name] for name in self.held)]

    def to_c(self) -> str:
        """Both as `vg_start` and `vg_update`."""
        p, u, x = (np.zeros(len(names)) for names in (self.entries, self.inputs, self.memory))
        functions = (
            emit_function("vg_start", self.start, {"p": p, "u": u}),
            emit_function("vg_update", self.update, {"p": p, "u": u, "x": x}),
        )
        return "\n".join([PRELUDE, *functions])

    def _named(self, u: Vector, last: Sequence[Array]) -> dict[str, Array]:
        given = {name: u[i] for i, name in enumerate(self.inputs)}
        held = {
            name: jnp.where(jnp.isfinite(given[name]), given[name], value)
            for name, value in zip(self.held, last, strict=True)
        }
        return given | held

    def _start(self, controller: AbstractController, given: dict[str, Array]) -> list[Array]:
        return jax.tree.leaves(controller.initial_state(_measurement(given)))

    def _update(
        self, controller: AbstractController, given: dict[str, Array], memory: Sequence[Array]
    ) -> tuple[list[Array], list[Array]]:
        state = jax.tree.unflatten(self._structure[1], memory)
        wanted = Reference(**{field: given.get(name, jnp.zeros(())) for name, field in WANTED.items()})
        after, command, log = controller.update(state, _measurement(given), wanted, self.period)
        return [saturate(command), command, *(log[name] for name in sorted(log))], jax.tree.leaves(after)

    @functools.cached_property
    def _structure(self) -> tuple[list[Any], Any]:
        nothing = _measurement({})
        shapes = jax.eval_shape(lambda: self.controller.initial_state(nothing))
        return jax.tree_util.tree_flatten_with_path(shapes)

    @functools.cached_property
    def _logged(self) -> list[str]:
        nothing, wanted = _measurement({}), Reference(*[jnp.zeros(())] * len(WANTED))

        def log() -> Any:
            state = self.controller.initial_state(nothing)
            return self.controller.update(state, nothing, wanted, self.period)[2]

        return sorted(jax.eval_shape(log))


def _measurement(given: dict[str, Array]) -> Measurement:
    return Measurement(**{field: given.get(name, jnp.zeros(())) for name, field in MEASURED.items()})


def _flat(leaves: list[Array]) -> list[Array]:
    """Their numbers one by one."""
    return [number.astype(float) for leaf in leaves for number in jnp.ravel(leaf)]
