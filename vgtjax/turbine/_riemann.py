"""States of the gas, and the flux between two of them."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Values
from ._gas import Gas

States = Float[Array, "... 4"]
"""`ln rho`, `V_m` in m/s, `K = r V_u` in m2/s, `ln p`: density and pressure are positive whatever a solver tries."""


SONIC = 0.01
"""Over the speed of sound, by how much the speeds of outer waves are rounded: in a duct that gas leaves at the speed of
sound they are zero in every cell, and Newton's steps went to and fro over their corners."""


def densities(gas: Gas, states: States, radius: Values) -> States:
    """Mass, meridional momentum, moment of momentum and energy in a cubic metre [3.25-3.35]."""
    density, velocity, swirl, pressure = unpack(states)
    kinetic = 0.5 * (velocity**2 + (swirl / radius) ** 2)
    energy = pressure / (gas.gamma - 1) + density * kinetic
    return jnp.stack([density, density * velocity, density * swirl, energy], axis=-1)


def states_of(gas: Gas, contents: States, radius: Values) -> States:
    """The inverse of `densities`."""
    density, momentum, moment, energy = jnp.moveaxis(contents, -1, 0)
    velocity, swirl = momentum / density, moment / density
    kinetic = 0.5 * (velocity**2 + (swirl / radius) ** 2)
    return pack(density, velocity, swirl, (gas.gamma - 1) * (energy - density * kinetic))


def flux(gas: Gas, states: States, radius: Values) -> States:
    """What crosses a square metre in a second."""
    _, velocity, _, pressure = unpack(states)
    carried = densities(gas, states, radius)
    pushed = jnp.stack([jnp.zeros_like(pressure), pressure, jnp.zeros_like(pressure), pressure * velocity], axis=-1)
    return carried * velocity[..., None] + pushed


def riemann_flux(gas: Gas, left: States, right: States, radius: Values) -> States:
    """Flux between two states by HLLC (Toro, Spruce and Speares 1994) with Davis's wave speeds (1988).

    Eigenvalues are `V_m, V_m, V_m +- a` (3.45, erratum E8). It has no entropy wave of its own, so a contact stays one.
    """
    (rho_l, v_l, _, p_l), (rho_r, v_r, _, p_r) = unpack(left), unpack(right)
    a_l, a_r = jnp.sqrt(gas.gamma * p_l / rho_l), jnp.sqrt(gas.gamma * p_r / rho_r)
    corner = SONIC * jnp.sqrt(a_l * a_r)
    slow, fast = jnp.minimum(v_l - a_l, v_r - a_r), jnp.maximum(v_l + a_l, v_r + a_r)
    push_l, push_r = rho_l * (slow - v_l), rho_r * (fast - v_r)
    contact = (p_r - p_l + push_l * v_l - push_r * v_r) / (push_l - push_r)
    from_left = _beside_contact(gas, left, radius, slow, contact, -_rounded(-slow, corner))
    from_right = _beside_contact(gas, right, radius, fast, contact, _rounded(fast, corner))
    return jnp.where((contact >= 0)[..., None], from_left, from_right)


def unpack(states: States) -> tuple[Values, Values, Values, Values]:
    """Density in kg/m3, meridional velocity in m/s, `r V_u` in m2/s, pressure in Pa."""
    return jnp.exp(states[..., 0]), states[..., 1], states[..., 2], jnp.exp(states[..., 3])


def pack(density: Values, velocity: Values, swirl: Values, pressure: Values) -> States:
    """The inverse of `unpack`."""
    return jnp.stack(jnp.broadcast_arrays(jnp.log(density), velocity, swirl, jnp.log(pressure)), axis=-1)


def _beside_contact(gas: Gas, states: States, radius: Values, wave: Values, contact: Values, passed: Values) -> States:
    """Flux behind an outer wave, on that side of the contact; `passed` is how fast the wave leaves the face in that
    direction, zero where it goes the other way and the flux is the undisturbed one."""
    density, velocity, swirl, pressure = unpack(states)
    here = densities(gas, states, radius)
    squeezed = density * (wave - velocity) / (wave - contact)
    work = (contact - velocity) * (contact + pressure / (density * (wave - velocity)))
    behind = squeezed[..., None] * jnp.stack(
        [jnp.ones_like(contact), contact, swirl, here[..., 3] / density + work], axis=-1
    )
    return flux(gas, states, radius) + passed[..., None] * (behind - here)


def _rounded(speed: Values, width: Values) -> Values:
    """The positive part of a speed, its corner rounded over a width on either side of zero, exact beyond."""
    inside = jnp.clip(speed + width, 0.0, 2 * width)
    return jnp.where(speed > width, speed, inside**2 / (4 * width))
