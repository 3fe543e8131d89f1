"""What air meets in a line: the speed of sound, and the friction of the wall [2.25, 2.30, 2.31]."""

import math

import jax.numpy as jnp

from ..._types import Values
from .._air import Air
from ..chamber import GasState

LAMINAR = 32.0
"""Poiseuille's `R_t D^2 / mu`."""
TURBULENT = 0.158
"""Blasius's `R_t D^2 / (mu Re^(3/4))` [2.31]."""
TRANSITION = (LAMINAR / TURBULENT) ** (4 / 3)
"""Reynolds number, 1187, at which the two are equal."""


def speed_of_sound(air: Air) -> Values:
    """Speed of sound in m/s at ambient temperature, whatever the chamber's: the wall keeps a line's air near it."""
    return jnp.sqrt(air.heat_capacity_ratio * air.gas_constant * air.temperature)


def cross_section(bore: Values) -> Values:
    """Area in m2 of a line of a bore in m."""
    return 0.25 * math.pi * bore**2


def resistance(mass_flow: Values, bore: Values, viscosity: Values) -> Values:
    """Pressure drop per length and mean velocity, `R_t` in Pa s/m2 [2.30].

    The larger of Blasius's [2.31] and the laminar `32 mu / D^2` (erratum): of the two Reynolds numbers rather than of
    their powers, so that the slope stays finite when nothing flows.

    **Arguments:** `mass_flow` in kg/s either way, `bore` in m, `viscosity` in Pa s.
    """
    # Air without viscosity has no resistance, rather than infinity times zero.
    reynolds = 4 * jnp.abs(mass_flow) / (math.pi * bore * jnp.maximum(viscosity, 1e-12))
    root = jnp.sqrt(jnp.maximum(reynolds, TRANSITION))
    return TURBULENT * viscosity * root * jnp.sqrt(root) / bore**2


def friction_rate(air: Air, gas: GasState, mass_flow: Values, bore: Values, viscosity: Values) -> Values:
    """Rate in 1/s at which friction stops a flow, `R_t / rho` [2.20] with `rho = p / (R T)` [2.25].

    **Arguments:** `gas` gives the density; the others as in [`resistance`][].
    """
    return resistance(mass_flow, bore, viscosity) * air.gas_constant * gas.temperature / gas.pressure
