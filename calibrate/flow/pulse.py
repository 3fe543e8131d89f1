"""One cycle of an engine: pressure before the turbine, the force that it makes at the rod, and how the rod moves."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import vgtjax
from vgtjax.exhaust import ASSUMED, Engine, ExhaustGas, OperatingPoint, Pulsation, pulsation
from vgtjax.parts import CRANK_RANGE, HIGHEST_PRESSURE, Vanes, flow_between
from vgtjax.plants import Rod

from ..study.disturbances import PulsationTable

USUAL = PulsationTable(engine_speed=ASSUMED["engine_speed"])
"""The engine of a study that has none."""
RATIO = 1.4
"""Of pressures over the turbine, about that engine's mean, at which the nozzle takes what the orifice takes."""
CYCLES, SAMPLES = 6, 2400
"""Cycles that are simulated, the last of which is shown, and samples of all."""

Cycle = Float[np.ndarray, " crank"]


@dataclasses.dataclass(frozen=True, eq=False)
class Pulse:
    """Over the crank angle of the engine in deg: pressure in Pa absolute, force in N, position in m."""

    engine: Engine
    point: OperatingPoint
    effective_area: float
    """m2 of the orifice whose flow decides where the vanes stand."""
    source: str
    """Of the point."""
    crank: Cycle
    pressure: Cycle
    force: Cycle
    position: dict[str, Cycle]
    """By what rubs."""

    def summary(self) -> dict[str, float]:
        """Means and ranges."""
        return {
            "engine_speed": float(self.point.engine_speed),
            "crank_angle": float(np.asarray(self.point.crank_angle)),
            "mean_pressure": float(np.mean(self.pressure)),
            "mean_force": float(np.mean(self.force)),
            "force_range": float(np.ptp(self.force)),
            **{f"position_range_{name.replace(' ', '_')}": float(np.ptp(x)) for name, x in self.position.items()},
        }


def engine_pulse(turbine: vgtjax.Turbine, table: PulsationTable | None = None, rod: Rod | None = None) -> Pulse:
    """The pulse of an engine, the assumed one at 1000 rpm under load unless a study has another, which empties its
    manifold, full of the turbine's gas, through the nozzle; a rod, the printed one if no other is given, balances the
    mean force where the nozzle takes what the engine's orifice takes.

    **Raises:** `SimulationError` when there is no periodic cycle, or the rod's simulation fails.
    """
    settings = USUAL if table is None else table
    engine = Engine(gas=ExhaustGas(turbine.gas.constant, turbine.gas.gamma))
    point = OperatingPoint(
        settings.engine_speed,
        settings.trapped_mass,
        settings.opening_temperature,
        turbine.outlet_pressure,
        turbine=turbine,
        crank_angle=matching_angle(turbine, engine, settings.effective_area),
    )
    cycle = pulsation(engine, point)
    opening = jnp.full(cycle.p_trb.shape, turbine.crank.opening(point.crank_angle))
    force = np.asarray(turbine(Vanes(opening, cycle.p_trb - turbine.ambient_pressure), 0.0, None)[0])
    rubbing = dataclasses.replace(rod or Rod(), vane_force=turbine)
    law = rubbing.friction.dry()
    damping = {} if law is None else {"viscous_damping": law.viscous_damping}
    free = dataclasses.replace(rubbing, friction=vgtjax.Coulomb(coulomb_force=0.0, **damping))
    rods = {"with friction": rubbing, "without dry friction": free}
    position = {name: _position(each, turbine, point, cycle, force) for name, each in rods.items()}
    source = "assumed" if table is None else "[pulsation] of the study"
    crank, pressure = np.asarray(cycle.crank), np.asarray(cycle.p_trb)
    return Pulse(engine, point, settings.effective_area, source, crank, pressure, force, position)


def not_counted(turbine: vgtjax.Turbine, table: PulsationTable | None) -> str | None:
    """A sentence on what a study states of its engine that a nozzle has itself, or makes; `None` where it states
    none."""
    stated = set() if table is None else table.model_fields_set
    names = [name for name in ("outlet_pressure", "amplitude") if name in stated]
    if not names:
        return None
    return (
        f"[pulsation] has no say here in {' and '.join(names)}: the engine empties through the nozzle, behind which "
        f"there are {float(turbine.outlet_pressure):.6g} Pa absolute"
    )


def matching_angle(turbine: vgtjax.Turbine, engine: Engine, area: float) -> float:
    """Crank angle in deg at which the nozzle takes what an orifice of an area in m2 takes, or the nearest one."""
    outlet = turbine.outlet_pressure
    pressure, temperature = jnp.minimum(RATIO * outlet, HIGHEST_PRESSURE), turbine.total_temperature
    taken, _ = flow_between(engine.gas, jnp.asarray(area), pressure, temperature, outlet, temperature)
    angles = np.linspace(*CRANK_RANGE, 331)
    flows = np.maximum.accumulate(turbine.mass_flow(jnp.full(angles.shape, pressure), jnp.asarray(angles)))
    return float(np.interp(float(taken), flows, angles))


def _position(rod: Rod, turbine: vgtjax.Turbine, point: OperatingPoint, cycle: Pulsation, force: Cycle) -> Cycle:
    """Of a rod in m that stands still against the mean force, in the last cycle of several."""
    model = vgtjax.MechanicalActuator(rod=rod)
    stands = float(model.diaphragm.travel - turbine.crank.opening(point.crank_angle))
    angle = 720.0 * CYCLES / SAMPLES * np.arange(SAMPLES + 1)
    pressure = np.interp(angle, cycle.crank, cycle.p_trb, period=720.0) - float(turbine.ambient_pressure)
    held = float(model.diaphragm.balance_force(stands)) + float(np.mean(force))
    trace = vgtjax.Trace(
        angle / (6 * float(point.engine_speed)),
        f_drive=np.full(angle.shape, held),
        x_d=np.full(angle.shape, stands),
        p_trb=pressure,
    )
    moved = np.asarray(vgtjax.simulate(model, trace).x_d)
    return np.interp(720.0 * (CYCLES - 1) + np.asarray(cycle.crank), angle, moved)
