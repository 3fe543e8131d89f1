"""What every map of the flow into the chamber answers."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..._types import Scalar, Values
from ...parameters import Part, parameter
from ._roots import falling_root

FULL_DUTY = 100.0
"""Percent; a duty lies between zero and this."""


def equilibrium_pressure() -> Any:
    """Declares `p_eq(u)`, at which the plunger closes, as a quartic; the default is for a reservoir of 20 kPa."""
    return parameter(
        (101843.62559540888, -12.98938307030129, -22.38163558106169, 0.20506743185078907, -5.242754662840745e-4),
        symbol="p_eq",
        unit=tuple(f"Pa/%^{k}" for k in range(5)),
        source="2.8, B.1",
        positive=False,
        held=True,
    )


class AbstractLiftMap(Part):
    """Mass flow into the chamber over plunger position and chamber pressure [5.1]."""

    ambient: eqx.AbstractVar[Scalar]
    """Atmosphere in Pa at which the map was made; at another one it is read at the same gauge pressure."""

    @abc.abstractmethod
    def __call__(self, position: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Flow in kg/s at a plunger position in m (up is positive) and a pressure in Pa absolute.

        `ambient` in Pa, that of the map where it is `None`.
        """


class AbstractFlowMap(Part):
    """Mass flow into the chamber over duty and chamber pressure [5.3], falling with both where it is valid.

    Arguments may be scalars or arrays of one shape: `duty` in percent, `pressure` in Pa absolute, `ambient` in Pa,
    that of the map where it is `None`. At another atmosphere a map is read at the same gauge pressure.
    """

    ambient: eqx.AbstractVar[Scalar]
    """Atmosphere in Pa at which the map was made."""

    @abc.abstractmethod
    def __call__(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Flow in kg/s, along its tangent outside the valid pressures. A duty beyond 0 to 100 % counts as the nearest
        one in it."""

    @abc.abstractmethod
    def valid(self, duty: Values, pressure: Values, ambient: Values | None = None) -> Bool[Array, "..."]:
        """Whether the map was made for this duty and pressure; what it says elsewhere is continued."""

    @abc.abstractmethod
    def duty_for(self, flow: Values, pressure: Values, ambient: Values | None = None) -> Values:
        """Duty in percent that gives a flow in kg/s, on the branch where flow falls with duty, clipped to 0 to 100.

        Differentiable where it is not clipped; where a map does not depend on duty at all (a saturated orifice) its
        derivative is zero.
        """

    def working_pressure(self, duty: Values, ambient: Values | None = None) -> Values:
        """Pressure in Pa absolute at which nothing flows, from vacuum to a fifth above the atmosphere."""
        return _working_pressure(self, duty, ambient)

    def gauge_shift(self, ambient: Values | None) -> Values:
        """How far in Pa an atmosphere lies above that of the map."""
        return jnp.zeros_like(self.ambient) if ambient is None else ambient - self.ambient


# Compiled here once for each kind of map: bisection in plain operations would be compiled at every call.
@eqx.filter_jit
def _working_pressure(flow_map: AbstractFlowMap, duty: Values, ambient: Values | None) -> Values:
    around = flow_map.ambient if ambient is None else ambient
    low = jnp.zeros_like(duty + around)
    return falling_root(lambda pressure: flow_map(duty, pressure, ambient), low, low + 1.2 * around)


@eqx.filter_jit
def duty_by_bisection(flow_map: AbstractFlowMap, flow: Values, pressure: Values, ambient: Values | None) -> Values:
    """`duty_for` of a map without a closed form."""
    low = jnp.zeros_like(flow + pressure)
    return falling_root(lambda duty: flow_map(duty, pressure, ambient) - flow, low, low + FULL_DUTY)
