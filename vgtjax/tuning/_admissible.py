"""Which gains a design may have: its conditions of stability as inequalities with derivatives."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..control import AbstractController, AdaptiveBackstepping, FrictionCompensation, Knocker, PressureObserver
from ..parameters import Selection, Transform
from ._parts import parts

MARGIN = 1e-3
"""A condition counts as kept with so much to spare: at its very edge a proof says nothing."""


def conditions(controller: AbstractController) -> dict[str, Float[Array, ""]]:
    """How far a controller is inside each condition of its design, as a part of the limit; negative outside.

    They are those that the parts check when they are built; a gain that must be positive is none of them, its domain
    says so.
    """
    return {prefix + name: value for prefix, part in parts(controller) for name, value in conditions_of(part).items()}


@functools.singledispatch
def conditions_of(part: eqx.Module) -> dict[str, Array]:
    """The conditions of one part alone; register those of a design of your own."""
    return {}


@conditions_of.register
def _(part: FrictionCompensation) -> dict[str, Array]:
    """[5.9] is strictly positive real."""
    margin = part.damping_margin()
    bound = part.derivative_gain - margin
    return {
        "derivative_gain above its bound [5.9]": margin / jnp.maximum(jnp.abs(bound), 1.0),
        "proportional_gain above its bound [5.9]": 1 + part.proportional_gain / part.diaphragm.stiffness,
    }


@conditions_of.register
def _(part: Knocker) -> dict[str, Array]:
    """A pulse ends before the next one begins."""
    return {"width below interval [5.5]": 1 - part.width / part.interval}


@conditions_of.register
def _(part: PressureObserver) -> dict[str, Array]:
    """[5.20, 5.21] corrected; the second one as a part of `a sigma_0 / sigma_1`."""
    margin = part.stability_margin()[0]
    scale = part.friction_rate * part.model.friction.bristle_stiffness / part.model.friction.bristle_damping
    return {
        "friction_rate below its bound [5.21]": 1 - part.friction_rate / jnp.min(part.largest_friction_rate()),
        "pressure_rate above its bound [5.21]": jnp.min(margin) / scale,
    }


@conditions_of.register
def _(part: AdaptiveBackstepping) -> dict[str, Array]:
    """[5.71] corrected; 1 - 1/ratio, which is bounded where the bound is zero."""
    lost = jnp.square((1 - part.pressure_coupling) * part.model.diaphragm.area / part.model.diaphragm.mass)
    bound = lost / (4 * part.velocity_gain * part.pressure_gain)
    return {"pressure_weight above its bound [5.71]": 1 - bound / part.pressure_weight}


def _spare(controller: AbstractController, selection: Selection, transform: Transform, coordinates: Array) -> Array:
    """How far coordinates are inside every condition, less [`MARGIN`][], of shape `(conditions,)`."""
    values = conditions(selection.unpack(controller, transform.to_physical(coordinates))).values()
    return jnp.stack(list(values)) - MARGIN if values else jnp.zeros(0)


spare = eqx.filter_jit(_spare)


@eqx.filter_jit
def spare_slopes(
    controller: AbstractController, selection: Selection, transform: Transform, coordinates: Array
) -> Float[Array, "conditions gains"]:
    """Derivatives of `spare` by the coordinates."""
    return jax.jacfwd(lambda at: _spare(controller, selection, transform, at))(coordinates)
