"""What nozzle and wheel pass on of the pressure behind them, where the vanes choke and before."""

import jax
import jax.numpy as jnp
import numpy as np

from vgtjax.parts import Stage
from vgtjax.turbine import CELLS, VANES, Nozzle, steady

from ..table import Section

BEFORE = 3e5
"""Pa absolute."""
SLOW = 12000.0
"""rad/s of the wheel; beside the design speed, 0.6 of the spouting velocity to 1.05 bar."""
ANGLES, OUTLETS = (5.0, 8.0, 45.0), (1.0e5, 0.8e5, 0.6e5, 0.4e5)
LENGTHS = (0.08, 0.04, 0.02)
"""Shares of the row over which gas takes the vanes' angle, the default one first."""
STANDING = (0.0, 0.3e5)
"""Speed of the wheel and Pa absolute behind it at which a row passes the most that it can."""
COLUMNS = (
    "wheel",
    "vanes",
    "behind",
    "mass flow",
    "below the most",
    "d ln q / d ln p_out",
    "Mach number",
    "half length",
    "quarter length",
)


def measure() -> Section:
    """Lowers the pressure behind the nozzle at two speeds of the wheel."""
    section = Section("The pressure behind a nozzle that chokes", _ABOUT, COLUMNS, notes=list(_NOTES))
    design = float(Stage().speed_at(jnp.asarray(BEFORE)))
    for speed in (SLOW, design):
        for degrees in ANGLES:
            for outlet in OUTLETS:
                section.add(*_row(speed, degrees, outlet))
    return section


def _row(speed: float, degrees: float, outlet: float) -> tuple[str, ...]:
    angle, others = float(np.radians(degrees)), []
    most, *_ = _passed(Nozzle(), angle, *STANDING)
    passed, slope, mach = _passed(Nozzle(), angle, speed, outlet)
    for length in LENGTHS[1:]:
        others.append(f"{float(_passed(Nozzle(loading_length=length), angle, speed, outlet)[1]):.4f}")
    return (
        f"{speed:.0f} rad/s",
        f"{degrees:g} deg",
        f"{outlet / 1e5:g} bar",
        f"{1e3 * float(passed):.2f} g/s",
        f"{100 * float(1 - passed / most):.2f} %",
        f"{float(slope):.4f}",
        f"{float(mach):.2f}",
        *others,
    )


@jax.jit
def _passed(nozzle: Nozzle, vane_angle: float, speed: float, outlet: float) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Mass flow in kg/s, the logarithmic derivative of it with respect to the outlet's pressure, and the Mach number
    behind the vanes; NaN where no flow is found."""
    stage = Stage(nozzle=nozzle)
    passage = nozzle.passage(vane_angle, speed, CELLS, stage.gas)
    inlet = nozzle.inlet(jnp.asarray(BEFORE), stage.total_temperature)

    def mass_flow(outlet: jax.Array) -> tuple[jax.Array, jax.Array]:
        flow = steady(passage, inlet, outlet, stage.gas)
        last = np.flatnonzero(passage.row == VANES)[-1]
        mach = jnp.hypot(flow.v_m, flow.v_u)[last] / stage.gas.sound_speed(flow.temperature[last])
        return jnp.where(flow.converged, flow.mass_flow, jnp.nan), mach

    at = jnp.asarray(outlet)
    passed, slope, mach = jax.jvp(mass_flow, (at,), (jnp.ones_like(at),), has_aux=True)
    return passed, slope * at / passed, mach


_ABOUT = (
    f"The default nozzle with {BEFORE / 1e5:g} bar absolute and 900 K before it, {CELLS} cells: mass flow, how far "
    "that is below the most that passes (with a standing wheel), its derivative, and the Mach number behind the vanes."
)
_NOTES = (
    f"The last columns are derivatives where gas takes the vanes' angle over {LENGTHS[1]:g} and {LENGTHS[2]:g} of the "
    f"row, not {LENGTHS[0]:g}.",
    "Open vanes don't choke; the duct behind the wheel does, where the meridional velocity is that of sound.",
)
