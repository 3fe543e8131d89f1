"""Statements on one-dimensional flow through the turbine [3.21-3.72] and on the engine in front of it [B.2.1]."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from vgtjax.exhaust import Engine, OperatingPoint, pulsation
from vgtjax.turbine import CELLS, Gas, Nozzle, steady

from .rows import Between, Found, Kind, Near, Row

MERIDIONAL, SWIRLING, SOUND, GAMMA = 0.3, 0.8, 1.0, 1.4
"""Velocities at which eigenvalues are taken, in units of that of sound."""
STEEP = 75.0
"""deg from the meridian, of a flow whose friction is counted."""
PRESSURE, OUTLET, TEMPERATURE = 3e5, 1.05e5, 900.0
"""Pa absolute before and behind the assumed nozzle, and K before it."""
VANE_ANGLES = np.array([4.0, 12.0, 20.0, 36.0, 52.0])
"""deg from the tangent, closed to open."""
LEVER = np.radians(48.0) / 10.13e-3
"""rad of the vanes a metre of the rod (section 3.6)."""
SPEED_RATIO = 0.6
"""Of the wheel's blades over the spouting velocity."""


def _jacobian(*, as_printed: bool) -> np.ndarray:
    """Of the flux of mass, both momenta and energy [3.45]."""

    def flux(contents: jax.Array) -> jax.Array:
        density, momentum, circumferential, energy = contents
        velocity = momentum / density
        kinetic = 0.5 * (momentum**2 + circumferential**2) / density
        pressure = (GAMMA - 1) * (energy - kinetic)
        return jnp.stack(
            [momentum, momentum * velocity + pressure, circumferential * velocity, (energy + pressure) * velocity]
        )

    energy = SOUND**2 / (GAMMA * (GAMMA - 1)) + 0.5 * (MERIDIONAL**2 + SWIRLING**2)
    matrix = np.array(jax.jacfwd(flux)(jnp.array([1.0, MERIDIONAL, SWIRLING, energy])))
    # Row 4, column 2 has `V_u^2 / 2` with the other sign in the print.
    matrix[3, 1] -= SWIRLING**2 if as_printed else 0.0
    return matrix


def _wave_speeds() -> Found:
    """The fastest of the four, and all of them with the sign put right."""
    printed, right = (np.sort(np.linalg.eigvals(_jacobian(as_printed=p)).real) for p in (True, False))
    facts = {"printed": ", ".join(f"{v:.3f}" for v in printed), "right": ", ".join(f"{v:.3f}" for v in right)}
    return Found(float(printed[-1]), facts)


def _friction_entropy() -> Found:
    """Entropy that (3.56) makes over a length of the passage, over that of the loss coefficient behind it."""
    return Found(1 / float(np.cos(np.radians(STEEP))), {"angle": f"{STEEP:g}"})


@functools.cache
def _forces() -> np.ndarray:
    """Force at the rod in N at every vane angle."""
    nozzle, gas = Nozzle(), Gas()
    falling = gas.heat_capacity * TEMPERATURE * (1 - gas.expanded_temperature(1.0, OUTLET / PRESSURE))
    speed = SPEED_RATIO * jnp.sqrt(2 * falling) / nozzle.rotor.inlet_radius

    def force(angle: jax.Array) -> jax.Array:
        passage = nozzle.passage(angle, speed, CELLS, gas)
        flow = steady(passage, nozzle.inlet(jnp.asarray(PRESSURE), TEMPERATURE), jnp.asarray(OUTLET), gas)
        return nozzle.vanes * LEVER * nozzle.vane_moment(passage, flow)[0]

    return np.asarray(jax.jit(lambda angles: jax.lax.map(force, angles))(jnp.radians(VANE_ANGLES)))


def _closed_force() -> Found:
    force = _forces()
    return Found(float(force[0]), {"least": f"{force.min():.1f}", "open": f"{force[-1]:.1f}"})


def _largest_at() -> Found:
    force = _forces()
    return Found(float(VANE_ANGLES[force.argmax()]), {"closed": f"{force[0]:.1f}", "most": f"{force.max():.1f}"})


def _clearance_ratio() -> Found:
    """Compression ratio with the printed clearance volume."""
    engine = Engine(clearance_volume=4417.8e-9)
    printed = float(engine.volume(180.0) / engine.volume(0.0))
    ours = Engine()
    return Found(printed, {"bore": f"{4417.8 / (np.pi / 4 * 75**2):.3f}", "assumed": f"{_ratio(ours):.1f}"})


def _ratio(engine: Engine) -> float:
    return float(engine.volume(180.0) / engine.volume(0.0))


def _displacement() -> Found:
    """cm3 of all cylinders."""
    engine = Engine()
    swept = engine.cylinders * float(engine.volume(180.0) - engine.volume(0.0)) * 1e6
    radius = 1e3 * float(engine.crank_radius) * 1560 / swept
    return Found(swept, {"needed": f"{radius:.2f}"})


def _pulsation() -> Found:
    """First order of the pressure before the turbine in mbar, of the assumed engine at 1000 rpm under load."""
    found = np.asarray(pulsation(Engine(), OperatingPoint.assumed()).p_trb)
    order = 2 * np.abs(np.fft.rfft(found))[4] / found.size
    return Found(float(order) / 100, {"mean": f"{np.mean(found) / 1e5:.3f}", "range": f"{np.ptp(found) / 100:.0f}"})


_flow = functools.partial(Row, section="3.5 Aerodynamic force by one-dimensional flow")
_engine = functools.partial(Row, section="B.2.1 Engine")

ROWS = (
    _flow(
        id="flow-waves",
        kind=Kind.IDENTITY,
        quantity="fastest eigenvalue of the matrix of (3.45) at V_m 0.3, V_u 0.8, a 1 and gamma 1.4",
        where="(3.45)",
        printed="V_m + a = 1.3",
        unit="",
        rule=Near(1.3, 0.0005),
        ours=_wave_speeds,
        reason="As printed the eigenvalues are {printed}. With `+ V_u^2 / 2` in row 4, column 2 they are {right}, as "
        "stated.",
    ),
    _flow(
        id="flow-friction",
        kind=Kind.IDENTITY,
        quantity="entropy that the friction of (3.56) makes, over that of its loss coefficient, at 75 deg",
        where="(3.56)",
        printed="1: by definition",
        unit="",
        rule=Near(1.0, 0.005),
        ours=_friction_entropy,
        reason="The force acts along the path, whose length at {angle} deg is {ours} times that along the meridian: "
        "V_m / W is missing.",
    ),
    _flow(
        id="flow-closed",
        kind=Kind.OWN_INPUTS,
        quantity="force at the rod with the vanes closed, 3 bar absolute before the turbine",
        where="(3.71), (3.72)",
        printed="none: the method is in progress",
        unit="N",
        rule=None,
        ours=_closed_force,
        reason="With sizes that we assumed {ours} N at 4 deg of the vanes; the least over their range is {least} N, "
        "and open it is {open} N. Nothing measured says whether that is so.",
        missing="the nozzle's sizes, the state of the gas, or any result of this method",
    ),
    _flow(
        id="flow-largest",
        kind=Kind.OWN_INPUTS,
        quantity="vane angle of the largest force at 3 bar absolute",
        where="section 3.6",
        printed="largest with the vanes closed, 4 deg",
        unit="deg",
        rule=Between(4.0, 8.0),
        ours=_largest_at,
        reason="In the geometry that we assumed the largest force is {most} N, against {closed} N closed. Where the "
        "pivot is and where gas turns between the vanes decide that.",
    ),
    _engine(
        id="engine-clearance",
        kind=Kind.IDENTITY,
        quantity="compression ratio that the printed clearance volume makes",
        where="B.2.1",
        printed="V_c = 4417.8 mm3",
        unit="",
        rule=Between(14.0, 22.0),
        ours=_clearance_ratio,
        reason="No Diesel engine has {ours}. The volume is the bore's area times {bore} mm; ours is that of an assumed "
        "ratio of {assumed}.",
    ),
    _engine(
        id="engine-displacement",
        kind=Kind.IDENTITY,
        quantity="volume that the pistons sweep, with the printed bore and crank radius",
        where="B.2.1",
        printed="an engine of 1560 cm3",
        unit="cm3",
        rule=Near(1560.0, 5.0),
        ours=_displacement,
        reason="1560 cm3 need a crank radius of {needed} mm; 45.5 mm are printed.",
    ),
    _engine(
        id="engine-pulsation",
        kind=Kind.OWN_INPUTS,
        quantity="first order of the pressure before the turbine at 1000 rpm",
        where="B.2.1",
        printed="none",
        unit="mbar",
        rule=None,
        ours=_pulsation,
        reason="With valves, charge and walls that we assumed the mean is {mean} bar absolute, the range {range} mbar.",
        missing="valves, charge, temperatures or a pulsation that was measured",
    ),
)
