"""What both reduced models have in common [5.2, 5.4]: gas at ambient temperature, whose pressure is the one state."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..._types import Values
from ...parts import Air, Flow, GasState, IsothermalChamber
from .._actuator import Actuator
from ._fitting import FlowMap


def pressure_rate(
    air: Air, chamber: IsothermalChamber, pressure: Values, flow: Values, displaced: Values, displacement_rate: Values
) -> Values:
    """`p' = (R T_atm m' + p A_d v) / V` in Pa/s, the last line of [5.2] and [5.4].

    **Arguments:** `pressure` in Pa absolute, `flow` in kg/s into the chamber, the volume that the diaphragm has swept
    in m3 and its rate in m3/s.
    """
    entering = Flow(flow, air.temperature)
    return chamber.rates(air, GasState(pressure, air.temperature), entering, displaced, displacement_rate).pressure


def flow_signals(pressure: Values, flow: Values) -> dict[str, Array]:
    """Pressure in Pa absolute, and a flow in kg/s into the chamber by its direction."""
    return {"p_act": pressure, "m_dot_in": jnp.maximum(flow, 0.0), "m_dot_out": jnp.maximum(-flow, 0.0)}


def parts_around(flow_map: FlowMap, model: Actuator) -> dict[str, Any]:
    """A map in the precision of a full model, and the parts of that which a reduced one takes over; line and heat are
    what it leaves out."""
    dtype = jnp.result_type(*[leaf for leaf in jax.tree.leaves(model) if eqx.is_inexact_array(leaf)])
    return {
        "flow_map": jax.tree.map(lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf, flow_map),
        "chamber": IsothermalChamber(volume=model.chamber.volume),
        "diaphragm": model.diaphragm,
        "friction": model.friction,
        "vane_force": model.vane_force,
        "air": model.air,
    }
