"""States at the faces of cells, second order where the flow is smooth.

What is interpolated is gas whose swirl is stopped without loss, and that swirl. Where blades take strong swirl out, its
energy is hundreds of times the meridional one, and what second order leaves of it in static pressures is as much as
that; the stopped gas hardly changes.
"""

import jax.numpy as jnp
import numpy as np

from .._types import Values
from ._gas import Gas
from ._passage import Passage
from ._riemann import States

SMOOTH_SLOPE = 0.02
"""Change over the length of the passage, in units of the usual sizes, below which slopes are not limited: it keeps the
limiter differentiable where nothing changes."""
STEEP = 4.0
"""How fast slopes at a row's edge go to zero with the Mach number beyond 1: gas that is there as fast as sound is soon
faster, and then has its shock, within a cell or two, of which one side says nothing."""
LEAST_TEMPERATURE = 0.1
"""Of gas that gets its swirl back over that of the stopped gas, whatever swirl a solver tries."""


def at_faces(passage: Passage, gas: Gas, states: States, scale: Values) -> tuple[States, States]:
    """States before and after each face (MUSCL); at the ends only the side within the passage means anything."""
    lengths, scale = 0.5 * jnp.diff(passage.m)[:, None], scale[None]
    stopped = _changed(gas, states, _swirling(passage, states, passage.centre_radius))
    mach = jnp.abs(states[:, 1]) / gas.sound_speed(_temperature(gas, states))
    back, on = _slopes(passage, stopped / scale, jnp.clip(1 + STEEP * (1 - mach), 0.0, 1.0))
    after, before = stopped - lengths * back * scale, stopped + lengths * on * scale
    after = _changed(gas, after, -_swirling(passage, after, passage.radius[:-1]))
    before = _changed(gas, before, -_swirling(passage, before, passage.radius[1:]))
    return jnp.concatenate([after[:1], before]), jnp.concatenate([after, before[-1:]])


def _temperature(gas: Gas, states: States) -> Values:
    """In K."""
    return jnp.exp(states[:, 3] - states[:, 0]) / gas.constant


def _swirling(passage: Passage, states: States, radius: Values) -> Values:
    """Energy of the swirl relative to the row, in J/kg."""
    return 0.5 * (states[:, 2] / radius - radius * passage.speed) ** 2


def _changed(gas: Gas, states: States, heat: Values) -> States:
    """Gas whose enthalpy changes by so much (J/kg) without loss, while as much passes."""
    ratio = 1 + heat / (gas.heat_capacity * _temperature(gas, states))
    denser = jnp.log(jnp.maximum(ratio, LEAST_TEMPERATURE)) / (gas.gamma - 1)
    density, velocity, swirl, pressure = states.T
    return jnp.stack([density + denser, velocity * jnp.exp(-denser), swirl, pressure + gas.gamma * denser], axis=-1)


def _slopes(passage: Passage, states: States, at_edges: Values) -> tuple[States, States]:
    """Towards the face before each cell, and the one after: of third order where cells are alike, limited as by
    Anderson, Thomas and van Leer (1986); of one side, times a share, where the other is another row, whose blades begin
    or end to turn the gas there."""
    between = jnp.diff(states, axis=0) / jnp.diff(passage.centres)[:, None]
    left, right = jnp.concatenate([between[:1], between]), jnp.concatenate([between, between[-1:]])
    row = jnp.asarray(passage.row)
    ends = np.ones(1, bool)
    edge = row[1:] != row[:-1]
    first, last = jnp.concatenate([ends, edge])[:, None], jnp.concatenate([edge, ends])[:, None]
    left, right = jnp.where(first, right, left), jnp.where(last, left, right)
    small = 2 * (SMOOTH_SLOPE / (passage.m[-1] - passage.m[0])) ** 2
    alike = (2 * jnp.maximum(left * right, 0.0) + small) / (left**2 + right**2 + small)
    alike = jnp.where(first & last, 0.0, jnp.where(first | last, alike * at_edges[:, None], alike))
    mean, bend = 0.5 * alike * (left + right), alike**2 / 6 * (right - left)
    return mean - bend, mean + bend
