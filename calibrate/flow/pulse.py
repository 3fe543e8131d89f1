"""One cycle of an engine: pressure before the turbine, the force that it makes at the rod, and how the rod moves."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import vgtjax
from vgtjax.exhaust import Engine, OperatingPoint, Pulsation, pulsation
from vgtjax.parts import Vanes
from vgtjax.traces import STANDARD_ATMOSPHERE

from .nozzle_map import NozzleMap

ENGINE_SPEED = 1000.0
"""rpm"""
CRANK_ANGLE = 6.7
"""deg of the actuator's crank at which the rod stands: there the default nozzle takes what the orifice takes."""
CYCLES, SAMPLES = 6, 2400
"""Cycles that are simulated, the last of which is shown, and samples of all."""

Cycle = Float[np.ndarray, " crank"]


@dataclasses.dataclass(frozen=True, eq=False)
class Pulse:
    """Over the crank angle of the engine in deg: pressure in Pa absolute, force in N, position in m."""

    engine_speed: float
    crank: Cycle
    pressure: Cycle
    force: Cycle
    position: dict[str, Cycle]
    """By what rubs."""

    def summary(self) -> dict[str, float]:
        """Means and ranges."""
        return {
            "engine_speed": self.engine_speed,
            "mean_pressure": float(np.mean(self.pressure)),
            "mean_force": float(np.mean(self.force)),
            "force_range": float(np.ptp(self.force)),
            **{f"position_range_{name.replace(' ', '_')}": float(np.ptp(x)) for name, x in self.position.items()},
        }


def engine_pulse(nozzle_map: NozzleMap) -> Pulse:
    """The pulse of the assumed engine at 1000 rpm under load, an orifice of the nozzle's size behind it; the rod
    balances the mean force.

    **Raises:** `SimulationError` when there is no periodic cycle, or the rod's simulation fails.
    """
    cycle = pulsation(Engine(), OperatingPoint(ENGINE_SPEED, 0.476e-3, 1150.0, 1.03e5, 87e-6))
    vane_force = force_table(nozzle_map)
    opening = jnp.full(cycle.p_trb.shape, vane_force.crank.opening(CRANK_ANGLE))
    force = np.asarray(vane_force.force(Vanes(opening, cycle.p_trb - STANDARD_ATMOSPHERE), 0.0))
    frictions = {"with friction": vgtjax.LuGre(), "without dry friction": vgtjax.Coulomb(coulomb_force=0.0)}
    position = {name: _position(friction, vane_force, cycle, force) for name, friction in frictions.items()}
    return Pulse(ENGINE_SPEED, np.asarray(cycle.crank), np.asarray(cycle.p_trb), force, position)


def force_table(nozzle_map: NozzleMap) -> vgtjax.HysteresisMap:
    """The map's force over gauge pressure and crank angle, the same both ways."""
    table = jnp.asarray(nozzle_map.values["rod_force"].ravel())
    gauge = jnp.asarray(nozzle_map.total_pressure - STANDARD_ATMOSPHERE)
    return vgtjax.HysteresisMap(
        closing=table, opening=table, turbine_pressure=gauge, crank_angle=jnp.asarray(nozzle_map.crank_angle)
    )


def _position(
    friction: vgtjax.AbstractFriction, vane_force: vgtjax.HysteresisMap, cycle: Pulsation, force: Cycle
) -> Cycle:
    """Of a rod in m that stands still against the mean force, in the last cycle of several."""
    model = vgtjax.MechanicalActuator(friction=friction, vane_force=vane_force)
    stands = float(model.diaphragm.travel - vane_force.crank.opening(CRANK_ANGLE))
    angle = 720.0 * CYCLES / SAMPLES * np.arange(SAMPLES + 1)
    pressure = np.interp(angle, cycle.crank, cycle.p_trb, period=720.0) - STANDARD_ATMOSPHERE
    held = float(model.diaphragm.balance_force(stands)) + float(np.mean(force))
    trace = vgtjax.Trace(
        angle / (6 * ENGINE_SPEED),
        f_drive=np.full(angle.shape, held),
        x_d=np.full(angle.shape, stands),
        p_trb=pressure,
    )
    moved = np.asarray(vgtjax.simulate(model, trace).x_d)
    return np.interp(720.0 * (CYCLES - 1) + np.asarray(cycle.crank), angle, moved)
