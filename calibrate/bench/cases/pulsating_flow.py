"""Force of the unsteady flow through the nozzle beside that of steady states, over one pulsation of the plenum."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from vgtjax.parts import Stage
from vgtjax.turbine import CELLS, Passage, PassageFlow, steady, unsteady

from ..table import Section

HERTZ, MEAN, SWING = 33.0, 2e5, 0.5e5
"""Of the plenum's pressure, in Pa absolute: a firing of a four-cylinder engine at 1000 rpm."""
STEPS, PRESSURES = 150, 31
"""Implicit steps of a pulsation; steady states over its pressures."""
SLOW = 9000.0
"""rad/s, half of what the wheel does at 0.6 of the spouting velocity of the mean pressure."""
LATEST = 0.3e-3
"""s by which a force is looked for before or behind."""
REFINED = ((5, 112), (5, 448))
"""Angles in deg that are repeated with other cells, at the slower speed."""
ANGLES = (5, 12, 30, 45)
COLUMNS = ("wheel", "vanes", "cells", "force", "differ by", "flow by", "a lag of", "leaves", "fill", "sound")


def measure() -> Section:
    """Marches through pulsations with the vanes and the wheel at several angles and speeds."""
    section = Section("A pulsation through the nozzle, unsteady and quasi-steady", _ABOUT, COLUMNS, notes=list(_NOTES))
    stage = Stage()
    design = float(stage.speed_at(jnp.asarray(MEAN)))
    cases = [(speed, degrees, CELLS) for speed in (SLOW, design) for degrees in ANGLES]
    for speed, degrees, cells in [*cases, *[(SLOW, *each) for each in REFINED]]:
        section.add(*_row(stage, speed, float(np.radians(degrees)), cells))
    return section


def _row(stage: Stage, speed: float, vane_angle: float, cells: int) -> tuple[str, ...]:
    """One pulsation, in words."""
    passage = stage.nozzle.passage(vane_angle, speed, cells, stage.gas)
    pressures = jnp.linspace(MEAN - SWING, MEAN + SWING, PRESSURES)
    calm, forces = _steady_states(stage, passage, pressures)
    times = np.linspace(0.0, 1 / HERTZ, STEPS + 1)
    _require_found(calm)
    first, middle = (jax.tree.map(lambda leaf, at=at: leaf[at], calm) for at in (0, PRESSURES // 2))
    flow, force = _unsteady(stage, passage, jnp.asarray(_pressure(times)), first, times)
    _require_found(flow)
    at, quasi_steady = np.asarray(pressures), CubicSpline(np.asarray(pressures), np.asarray(forces))

    def off(lag: float) -> float:
        return float(np.max(np.abs(np.asarray(force) - quasi_steady(_pressure(times - lag)))))

    found = minimize_scalar(off, bounds=(-LATEST, LATEST), method="bounded", options={"xatol": 1e-7})
    passing = CubicSpline(at, np.asarray(calm.mass_flow))(_pressure(times))
    contents = CubicSpline(at, np.asarray(calm.density @ passage.volume))
    filling = float(contents(MEAN, 1) / CubicSpline(at, np.asarray(calm.mass_flow))(MEAN, 1))
    return (
        f"{speed:.0f} rad/s",
        f"{np.degrees(vane_angle):.0f} deg",
        str(cells),
        f"{np.min(force):.1f} to {np.max(force):.1f} N",
        f"{off(0.0):.3f} N",
        f"{100 * np.max(np.abs(np.asarray(flow.mass_flow) / passing - 1)):.2f} %",
        f"{1e3 * found.x:.3f} ms",
        f"{found.fun:.3f} N",
        f"{1e3 * filling:.2f} ms",
        f"{1e3 * _sound_to_vanes(stage, passage, middle):.3f} ms",
    )


def _pressure(time: Any) -> Any:
    """In the plenum in Pa absolute at times in s; it rests at first, as the steady flow does that is begun with."""
    return MEAN - SWING * np.cos(2 * np.pi * HERTZ * time)


def _require_found(flow: PassageFlow) -> None:
    """**Raises:** `RuntimeError` where a flow was not found."""
    if not bool(jnp.all(flow.converged)):
        raise RuntimeError("a flow of the pulsation was not found; look for why")


@jax.jit
def _steady_states(stage: Stage, passage: Passage, pressures: jax.Array) -> tuple[PassageFlow, jax.Array]:
    """Flows at pressures in Pa absolute, and their forces at the rod in N."""

    def one(pressure: jax.Array) -> tuple[PassageFlow, jax.Array]:
        inlet = stage.nozzle.inlet(pressure, stage.total_temperature)
        flow = steady(passage, inlet, stage.outlet_pressure, stage.gas)
        return flow, stage.force(stage.nozzle.vane_moment(passage, flow)[0])

    return jax.lax.map(one, pressures)


@jax.jit
def _unsteady(
    stage: Stage, passage: Passage, pressures: jax.Array, first: PassageFlow, times: jax.Array
) -> tuple[PassageFlow, jax.Array]:
    """The flow at times in s behind a plenum of such pressures in Pa absolute, and its forces at the rod in N."""
    state = first.density, first.v_m, first.v_u, first.pressure
    inlet = stage.nozzle.inlet(pressures, stage.total_temperature)
    flow = unsteady(passage, inlet, stage.outlet_pressure, state, times, stage.gas)
    return flow, jax.vmap(lambda flow: stage.force(stage.nozzle.vane_moment(passage, flow)[0]))(flow)


def _sound_to_vanes(stage: Stage, passage: Passage, flow: PassageFlow) -> float:
    """Time in s that sound takes from the inlet to the trailing edges of the vanes."""
    speed = flow.v_m + stage.gas.sound_speed(flow.temperature)
    last = np.flatnonzero(np.asarray(passage.row) == 1)[-1]
    return float(np.sum((np.diff(passage.m) / np.asarray(speed))[: last + 1]))


_ABOUT = (
    f"The default nozzle behind a plenum of {MEAN / 1e5:g} +- {SWING / 1e5:g} bar absolute at {HERTZ:g} Hz, in {STEPS} "
    "implicit steps, beside steady states at the pressures of the same moments."
)
_NOTES = (
    "A lag is that of the steady states' force that comes nearest, negative where the unsteady force comes first, and "
    "leaves what it does not explain. Fill: how much more gas is in the passage over how much more flows, at a higher "
    "pressure of the plenum. Sound: from the inlet to the trailing edges.",
    "The wheel turns at half and at all of its design speed, 0.6 of the spouting velocity at the mean pressure.",
)
