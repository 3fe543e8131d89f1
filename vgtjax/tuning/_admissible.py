"""Which parameters of a design are gains, and where they may be: its conditions, inequalities with derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import Vector
from ..control import AbstractController, AbstractDesign, designs_in
from ..parameters import Selection, Transform, parameter_table

MARGIN = 1e-3
"""A condition counts as kept with so much to spare: at its very edge a proof says nothing."""


def gain_names(controller: AbstractController) -> list[str]:
    """Parameters of a controller and of the designs inside it that are not held; what it believes of a plant is none.

    A component that is no [`AbstractDesign`][] is what the controller believes.
    """
    own = {prefix for prefix, _ in designs_in(controller)}
    table = parameter_table(controller)
    return [name for name, row in table.items() if not row.held and name[: name.rfind(".") + 1] in own]


def conditions(controller: AbstractDesign) -> dict[str, Float[Array, ""]]:
    """How far a design is inside each of its conditions, as a part of the limit; negative outside.

    They are those that it and its parts check when they are built, but for signs: a gain's domain holds its sign.
    """
    return {
        prefix + name: jnp.min(condition.margin)
        for prefix, design in designs_in(controller)
        for name, condition in design.conditions().items()
        if condition.bounds_gains
    }


def conditions_asked(controller: AbstractDesign) -> dict[str, float]:
    """The same, without conditions that ask for nothing: a bound for errors that nobody has stated."""
    margins = conditions(controller)
    idle = {
        prefix + name
        for prefix, design in designs_in(controller)
        for name, condition in design.conditions().items()
        if not np.any(condition.asked)
    }
    return {name: float(margin) for name, margin in margins.items() if name not in idle}


def _spare(controller: AbstractController, selection: Selection, transform: Transform, coordinates: Vector) -> Array:
    """How far coordinates are inside every condition, less [`MARGIN`][], of shape `(conditions,)`."""
    values = conditions(selection.unpack(controller, transform.to_physical(coordinates))).values()
    return jnp.stack(list(values)) - MARGIN if values else jnp.zeros(0)


spare = eqx.filter_jit(_spare)


@eqx.filter_jit
def spare_slopes(
    controller: AbstractController, selection: Selection, transform: Transform, coordinates: Vector
) -> Float[Array, "conditions gains"]:
    """Derivatives of `spare` with respect to the coordinates."""
    return jax.jacfwd(lambda at: _spare(controller, selection, transform, at))(coordinates)
