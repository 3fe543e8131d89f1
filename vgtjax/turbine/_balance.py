"""What a cell gains and loses: quasi-one-dimensional flow with swirl, blades, friction and heat [3.21-3.59]."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Scalar, Values
from ._gas import Gas
from ._passage import Inlet, Passage
from ._reconstruction import at_faces
from ._riemann import States, densities, flux, pack, riemann_flux, unpack

LEAST_TEMPERATURE = 0.2
"""Of the gas at the inlet over its total temperature, whatever velocity a solver tries there."""
TURNING_SPEED = 1e-3
"""Speed over that of sound below which blades let go of the gas: in a rotor that turns in gas at rest their force would
jump where the flow turns back."""


Faces = tuple[States, States]
"""States before and after each face."""


class Forces(eqx.Module):
    """Forces on the gas of each cell in N/m3: of blades, of friction, and of what swirls on a radius that changes."""

    blade_m: Values
    blade_u: Values
    friction_m: Values
    friction_u: Values
    centrifugal: Values


class Ends(eqx.Module):
    """What is known at the ends of a passage; without an inlet both are open."""

    inlet: Inlet | None
    outlet_pressure: Scalar | None

    def towards(self, other: "Ends", share: Values) -> "Ends":
        """What is known a share of the way to other ends."""
        return jax.tree.map(lambda here, there: here + share * (there - here), self, other)


class Balance(eqx.Module):
    """The balances of all cells of a passage between its ends."""

    passage: Passage
    gas: Gas
    scale: Float[Array, " 4"]
    """Usual sizes of `ln rho`, `V_m`, `r V_u` and `ln p`."""
    usual: Float[Array, " 4"]
    """Of mass, momentum, moment of momentum and energy that pass in a second."""
    ends: Ends

    def __call__(self, states: States) -> Float[Array, "cells 4"]:
        """What each cell loses in a second: mass (kg), momentum (N), moment of momentum (N m), energy (W) [3.44,
        corrected]."""
        passage, faces = self.passage, self.at_faces(states)
        through = self.fluxes(faces) * passage.area[:, None]
        forces = self.forces(states, faces)
        radius, volume = passage.centre_radius, passage.volume
        along = volume * (forces.blade_m + forces.friction_m + forces.centrifugal)
        along = along + unpack(states)[3] * jnp.diff(passage.area)
        moment = volume * radius * (forces.blade_u + forces.friction_u)
        power = passage.speed * moment + volume * passage.heat
        return jnp.diff(through, axis=0) - jnp.stack([jnp.zeros_like(along), along, moment, power], axis=-1)

    def at_faces(self, states: States) -> Faces:
        """States before and after each face."""
        return at_faces(self.passage, self.gas, states, self.scale)

    def stored(self, states: States) -> Float[Array, "cells 4"]:
        """Mass, momentum, moment of momentum and energy in each cell."""
        return densities(self.gas, states, self.passage.centre_radius) * self.passage.volume[:, None]

    def between(self, ends: Ends) -> "Balance":
        """The balance between other ends."""
        return Balance(self.passage, self.gas, self.scale, self.usual, ends)

    def forces(self, states: States, faces: Faces) -> Forces:
        """Forces of blades [3.48-3.53] and of friction [3.54-3.58] on the gas; see the manual for what the print has
        wrong."""
        passage, radius = self.passage, self.passage.centre_radius
        density, velocity, swirl, _ = unpack(states)
        relative = swirl / radius - radius * passage.speed
        turned = density * self._direction(velocity) * (velocity * passage.tangent - relative) / passage.length
        turned = jnp.where(passage.row > 0, turned, 0.0)
        speed = jnp.sqrt(velocity**2 + relative**2 + (1e-9 * self.scale[1]) ** 2)
        drag = 0.5 * density * passage.friction * speed
        # Both along `m` together are the change of `K^2 / (2 r^2) - Omega K` from face to face, with swirl as it
        # crosses them: turning costs no entropy then, by whatever cells [3.51].
        before, after = faces
        carried = after[:, 2] + 0.5 * (1 + self._direction(before[:, 1] + after[:, 1])) * (before[:, 2] - after[:, 2])
        first, last = 1 / passage.radius[:-1] ** 2, 1 / passage.radius[1:] ** 2
        around = 0.25 * (carried[:-1] + carried[1:]) * (first + last) - passage.speed
        centrifugal = 0.25 * density * (carried[:-1] ** 2 + carried[1:] ** 2) * (first - last) / jnp.diff(passage.m)
        return Forces(-turned * radius * around, turned * velocity, -drag * velocity, -drag * relative, centrifugal)

    def _direction(self, velocity: Values) -> Values:
        """1 where gas goes on, -1 where it comes back, 0 at rest."""
        return velocity / jnp.sqrt(velocity**2 + (TURNING_SPEED * self.scale[1]) ** 2)

    def fluxes(self, faces: Faces) -> Float[Array, "faces 4"]:
        """What crosses a square metre of each face in a second."""
        radius, gas = self.passage.radius, self.gas
        before, after = faces
        inside = riemann_flux(gas, before[1:-1], after[1:-1], radius[1:-1])
        first, last = after[0], before[-1]
        entering = flux(gas, first if self.ends.inlet is None else self.entering(self.ends.inlet, first), radius[0])
        leaving = last if self.ends.outlet_pressure is None else self.leaving(self.ends.outlet_pressure, last)
        return jnp.concatenate([entering[None], inside, riemann_flux(gas, last, leaving, radius[-1])[None]])

    def entering(self, inlet: Inlet, inside: States) -> States:
        """Gas at the inlet, at the velocity that the passage takes it at, as far as to the speed of sound: in a passage
        that widens at once more does not pass. Gas that goes back is no longer the plenum's."""
        gamma, constant = self.gas.gamma, self.gas.constant
        share = 1 + 0.5 * (gamma - 1) * (1 + inlet.tangent**2)
        velocity = jnp.minimum(inside[1], jnp.sqrt(gamma * constant * inlet.total_temperature / share))
        kinetic = 0.5 * velocity**2 * (1 + inlet.tangent**2)
        ratio = jnp.maximum(1 - kinetic / (self.gas.heat_capacity * inlet.total_temperature), LEAST_TEMPERATURE)
        pressure = self.gas.expanded_pressure(inlet.total_pressure, ratio)
        density = pressure / (self.gas.constant * inlet.total_temperature * ratio)
        coming = pack(density, velocity, self.passage.radius[0] * velocity * inlet.tangent, pressure)
        return jnp.where(inside[1] < 0, self.going_back(inlet, inside), coming)

    def going_back(self, inlet: Inlet, inside: States) -> States:
        """Gas that leaves through the inlet: with its own entropy, swirl and velocity, against the plenum's pressure,
        which has no say any more where it is as fast as sound. At rest it pushes as gas that comes does."""
        density, velocity, swirl, pressure = unpack(inside)
        fast = jnp.clip(-velocity / jnp.sqrt(self.gas.gamma * pressure / density), 0.0, 1.0)
        behind = jnp.maximum(inlet.total_pressure, pressure * fast**2)
        return pack(density * (behind / pressure) ** (1 / self.gas.gamma), velocity, swirl, behind)

    def leaving(self, outlet_pressure: Values, inside: States) -> States:
        """Gas behind a simple wave that comes in from the outlet's pressure, as far as to the speed of sound.

        A wave can't make the gas faster than sound where it leaves, so below that pressure the outlet has no say. Where
        it comes back in, it has the entropy and swirl of the gas it meets: nothing says what is behind the outlet.
        """
        density, velocity, swirl, pressure = unpack(inside)
        gamma = self.gas.gamma
        sound = jnp.sqrt(gamma * pressure / density)
        sonic = (2 * sound + (gamma - 1) * velocity) / (gamma + 1)
        exponent = 2 * gamma / (gamma - 1)
        choked = pressure * (jnp.maximum(sonic, 0.1 * sound) / sound) ** exponent
        behind = jnp.maximum(outlet_pressure, choked)
        there = sound * (behind / pressure) ** (1 / exponent)
        faster = velocity + 2 / (gamma - 1) * (sound - there)
        return pack(density * (behind / pressure) ** (1 / gamma), faster, swirl, behind)


def balance_of(passage: Passage, ends: Ends, gas: Gas, density: Values, sound: Values) -> Balance:
    """The balance between two ends; a usual density in kg/m3 and speed of sound in m/s scale it."""
    one, swirl = jnp.ones_like(sound), sound * passage.radius[0]
    usual = density * sound * jnp.max(passage.area) * jnp.stack([one, sound, swirl, sound**2])
    return Balance(passage, gas, jnp.stack([one, sound, swirl, one]), usual, ends)


def balance_from(passage: Passage, inlet: Inlet, outlet_pressure: Scalar | None, gas: Gas) -> Balance:
    """The balance between a plenum and an outlet, scaled by the gas in the plenum."""
    sound = gas.sound_speed(inlet.total_temperature)
    return balance_of(passage, Ends(inlet, outlet_pressure), gas, inlet.density(gas), sound)
