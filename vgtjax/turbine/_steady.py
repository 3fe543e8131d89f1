"""Steady flow: the states in which all cells balance, and what they mean."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._errors import require_positive
from .._types import Scalar, Tree, Values
from ._balance import Balance, balance_from
from ._gas import Gas
from ._newton import AbstractProblem, Ending, solve
from ._passage import Inlet, Passage
from ._riemann import States, pack, unpack

FIRST_CFL, CAREFUL_CFL, NEAR_CFL = 5.0, 1.0, 1e8
"""Lengths of the first step of the search in transits of a cell by sound: from the first guess; by continuation, which
a wheel at twice its design speed needs; and from a flow nearby, where plain Newton steps, half as many, get there."""
LEAST_SPEED = 0.01
"""Over that of sound, what the fastest gas of a passage needs for its direction to mean anything: where a wheel pumps
against the pressure before it, and at rest, gas goes to and fro by rounding."""


class PassageFlow(eqx.Module):
    """Flow through a passage, one value per cell unless said; with a leading axis of times from `unsteady`."""

    m: Values
    """Distance along the passage, in m."""
    density: Values
    """kg/m3."""
    v_m: Values
    """Meridional velocity in m/s."""
    v_u: Values
    """Circumferential velocity in m/s, absolute frame."""
    pressure: Values
    """Pa absolute."""
    temperature: Values
    """K."""
    mass_flow: Values
    """kg/s; where the gas leaves."""
    power: Values
    """Power at the shaft in W that the gas gives away."""
    blade_force: Values
    """Circumferential force of the blades on the gas of each cell, in N."""
    converged: Bool[Array, "..."]
    """Whether all balances hold."""
    ending: Ending | None = None
    """How the search for a steady flow ended."""


def steady(passage: Passage, inlet: Inlet, outlet_pressure: Scalar, gas: Gas) -> PassageFlow:
    """Steady flow through a passage, subsonic, choked or with a shock.

    Differentiable in both modes by the implicit function theorem. Where `converged` is false no other value means
    anything, nor does a derivative; `ending` then says how far the search came from gas at rest.

    **Arguments:** `outlet_pressure` in Pa absolute.

    **Raises:** `InputError` for an outlet pressure that is not positive.
    """
    return steady_near(passage, inlet, outlet_pressure, gas)[0]


def steady_near(
    passage: Passage, inlet: Inlet, outlet_pressure: Scalar, gas: Gas, near: States | None = None
) -> tuple[PassageFlow, States]:
    """`steady`, searched from the states of a flow nearby, and the states that it ends at, without derivatives.

    **Raises:** as `steady`.
    """
    require_positive("outlet_pressure", outlet_pressure, "pressure in Pa absolute", "correct it")
    passage, inlet, outlet_pressure, gas = as_plain_arrays((passage, inlet, outlet_pressure, gas))
    if near is None:
        return _steady_from(first_guess(passage, inlet, gas), FIRST_CFL, passage, inlet, outlet_pressure, gas)
    return _steady_from(near, NEAR_CFL, passage, inlet, outlet_pressure, gas)


@eqx.filter_jit
def _steady_from(
    start: States, first_cfl: float, passage: Passage, inlet: Inlet, outlet_pressure: Scalar, gas: Gas
) -> tuple[PassageFlow, States]:
    """One program for all passages of as many cells."""
    problem = _Steady(passage, inlet, outlet_pressure, gas)
    states, ending = solve(problem, start, first_cfl, CAREFUL_CFL)
    flow = dataclasses.replace(flow_of(problem.balance, states, ending.converged), ending=ending)
    return flow, jax.lax.stop_gradient(states)


def as_plain_arrays(tree: Tree) -> Tree:
    """The same with arrays for numbers, real ones in one precision; those of Python, and JAX's of weak type, would make
    programs of their own."""
    real = [leaf for leaf in jax.tree.leaves(tree) if _is_real(leaf)]
    precision = jnp.result_type(*real)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, precision if _is_real(leaf) else jnp.result_type(leaf)), tree)


def _is_real(leaf: Any) -> bool:
    return jnp.issubdtype(jnp.result_type(leaf), jnp.inexact)


class _Steady(AbstractProblem):
    """Flow between a plenum and an outlet in which nothing is lost."""

    balance: Balance
    inlet: Inlet
    outlet_pressure: Scalar

    def __init__(self, passage: Passage, inlet: Inlet, outlet_pressure: Scalar, gas: Gas):
        self.balance = balance_from(passage, inlet, outlet_pressure, gas)
        self.inlet, self.outlet_pressure = inlet, outlet_pressure

    def __call__(self, states: States) -> Float[Array, "cells 4"]:
        """See the base class."""
        return self.balance(states)

    def is_flow(self, states: States) -> Bool[Array, ""]:
        """Whether all cells of blades flow the same way, as mass does. They push gas on in the direction that it
        has, so that one cell of closed vanes may flow back and its neighbours make up for that. Nor does gas come back
        against a pressure that falls towards the outlet: of what comes in there nothing says how hot it is."""
        speeds = unpack(states)[1] / self.balance.scale[1]
        slow = jnp.max(jnp.abs(speeds)) < LEAST_SPEED
        free = jnp.asarray(self.balance.passage.row) == 0
        back = (self.outlet_pressure > self.inlet.total_pressure) & jnp.all(free | (speeds < 0))
        return slow | jnp.all(free | (speeds > 0)) | back

    def eased(self, share: Values) -> "_Steady":
        """A share of the pressure difference, and a wheel so much slower that its speed ratio stays."""
        passage, total = self.balance.passage, self.inlet.total_pressure
        slower = eqx.tree_at(
            lambda passage: (passage.speed, passage.heat),
            passage,
            (passage.speed * jnp.sqrt(share), passage.heat * share**1.5),
        )
        return _Steady(slower, self.inlet, total * (self.outlet_pressure / total) ** share, self.balance.gas)

    def eased_start(self, start: States, share: Values) -> States:
        """Velocities go with the root of a pressure difference."""
        root = jnp.sqrt(share)
        density = self.inlet.density(self.balance.gas)
        rest = pack(density, jnp.zeros_like(density), jnp.zeros_like(density), self.inlet.total_pressure)[None]
        return rest + (start - rest) * jnp.stack([share, root, root, share])[None]


def flow_of(balance: Balance, states: States, converged: Bool[Array, "..."]) -> PassageFlow:
    """What a state of all cells means."""
    passage, gas = balance.passage, balance.gas
    density, velocity, swirl, pressure = unpack(states)
    faces = balance.at_faces(states)
    forces = balance.forces(states, faces)
    moment = passage.volume * passage.centre_radius * (forces.blade_u + forces.friction_u)
    return PassageFlow(
        passage.centres,
        density,
        velocity,
        swirl / passage.centre_radius,
        pressure,
        pressure / (gas.constant * density),
        balance.fluxes(faces)[-1, 0] * passage.area[-1],
        -jnp.sum(passage.speed * moment),
        passage.volume * forces.blade_u,
        converged,
    )


@eqx.filter_jit
def first_guess(passage: Passage, inlet: Inlet, gas: Gas) -> States:
    """A small flow that follows the blades, marched through the passage without loss."""
    radius = passage.centre_radius
    density = inlet.density(gas)
    area = passage.volume / jnp.diff(passage.m)
    cosine = jnp.where(passage.row > 0, 1 / jnp.sqrt(1 + passage.tangent**2), 1 / jnp.sqrt(1 + inlet.tangent**2))
    velocity = 0.2 * gas.sound_speed(inlet.total_temperature) * jnp.min(area * cosine) / area
    turned = radius * (velocity * passage.tangent + radius * passage.speed)

    kept = jnp.where(passage.row > 0, jnp.exp(-jnp.diff(passage.m) / passage.length), 1.0)

    def follow(carry: Any, cell: Any) -> tuple[Any, Any]:
        swirl, enthalpy = carry
        wanted, speed, kept = cell
        onward = wanted + kept * (swirl - wanted)
        after = onward, enthalpy + speed * (onward - swirl)
        return after, after

    at_rest = gas.heat_capacity * inlet.total_temperature
    entering = passage.radius[0] * velocity[0] * inlet.tangent
    _, (swirl, enthalpy) = jax.lax.scan(follow, (entering, at_rest), (turned, passage.speed, kept))
    kinetic = 0.5 * (velocity**2 + (swirl / radius) ** 2)
    ratio = jnp.clip((enthalpy - kinetic) / at_rest, 0.5, 2.0)
    expanded = gas.expanded_pressure(inlet.total_pressure, ratio)
    return pack(density * ratio ** (1 / (gas.gamma - 1)), velocity, swirl, expanded)
