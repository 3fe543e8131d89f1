"""Statements on the coil, the static magnetic force, and the balance of the plunger [2.1-2.12, B.1]."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from vgtjax.parts import Plunger

from . import experiments
from .rows import Between, Found, Kind, Near, Row

ROUNDED = (0.02173, 0.00226, 0.0039, -3.573e-5, 9.135e-8)
"""Coefficients of (2.9), from the constant up; (B.1) prints more digits."""
HALF_DIGIT = 0.5e-4
"""N/%^2; half of the last digit of 0.0039, the coefficient of the square in both prints."""
ANY_PERMEABILITY = 1000.0
"""Relative permeability of the core; the two statements about it hold for any."""


def magnetic_force(duty: np.ndarray) -> np.ndarray:
    """Pull of the solenoid in N at a duty in percent [B.1]."""
    magnet = experiments.actuator().converter.magnetic_force
    return np.asarray(jax.vmap(lambda pwm: magnet.steady_pull(pwm, jnp.zeros(())))(jnp.asarray(duty)))


def _rounding() -> Found:
    duty = np.linspace(0, 100, 201)
    apart = np.abs(magnetic_force(duty) - np.polynomial.Polynomial(ROUNDED)(duty))
    return Found(
        1e3 * float(apart.max()), {"duty": f"{duty[apart.argmax()]:g}", "mbar": f"{_as_pressure(apart.max()):.2g}"}
    )


def _as_pressure(force: float) -> float:
    """What a force on the plunger is worth in chamber pressure, in mbar [2.8]."""
    return float(force / experiments.actuator().converter.actuator_area) / experiments.MBAR


def _last_digit() -> Found:
    newton = HALF_DIGIT * 100.0**2
    return Found(_as_pressure(newton), {"newton": f"{newton:.2g}"})


def square_law(duty: np.ndarray) -> np.ndarray:
    """Force in N that goes with the square of the duty, as `i = U / R` gives it, closest to (B.1) by least squares."""
    force, square = magnetic_force(duty), duty**2
    return square * float(square @ force / (square @ square))


def _full_duty() -> Found:
    duty = np.linspace(0, 100, 201)
    apart = np.abs(square_law(duty) - magnetic_force(duty))
    return Found(float(magnetic_force(duty)[-1]), {"square": f"{apart.max():.1f}"})


def _balance_pressure(duty: float) -> float:
    """Gauge pressure in mbar at which the closed plunger balances [2.8]."""
    converter = experiments.actuator().converter
    ambient, reservoir = jnp.asarray(experiments.STANDARD_ATMOSPHERE), jnp.asarray(experiments.ASSUMED_RESERVOIR)
    pressure = converter.working_pressure(jnp.asarray(duty), ambient, reservoir)
    return float(pressure - ambient) / experiments.MBAR


def _steady_pressure() -> Found:
    """How far simulated steady pressures lie from (2.8), in mbar."""
    reached = {duty: experiments.response(duty).pressure[-1] for duty in experiments.DUTIES}
    gauge = {duty: (p - experiments.STANDARD_ATMOSPHERE) / experiments.MBAR for duty, p in reached.items()}
    apart = [gauge[duty] - _balance_pressure(duty) for duty in experiments.DUTIES]
    levels = ", ".join(f"{value:.0f}" for value in gauge.values())
    return Found(tuple(float(value) for value in apart), {"levels": levels})


def _coil(position: jax.Array, sign: float) -> jax.Array:
    """Inductance in units of `N^2 A mu_0` [2.2, 2.3] with `mu_r (x_t + sign x_p)` in the flux path; lengths in mm."""
    length, gap = 20.0, 2.0
    return ANY_PERMEABILITY / (length + ANY_PERMEABILITY * (gap + sign * position))


def _coil_direction() -> Found:
    as_printed, counted_up = (float(jax.grad(_coil)(jnp.zeros(()), sign)) for sign in (-1.0, 1.0))
    return Found(float(np.sign(as_printed)), {"corrected": f"{np.sign(counted_up):g}"})


def _coil_energy() -> float:
    """Force by virtual work, `i^2/2 |dL/dx|`, over force by (2.6), both per `i^2 N^2 A mu_0`."""
    inductance, slope = jax.value_and_grad(_coil)(jnp.zeros(()), 1.0)
    return float(jnp.abs(slope) / 2 / (inductance**2 / 2))


def _stiffness() -> Found:
    """Restoring force over a tenth of a millimetre below the closed position, and above it, in N/m."""
    converter = experiments.actuator().converter
    zero = jnp.zeros(())

    def force(lift: jax.Array) -> jax.Array:
        plunger = Plunger(lift, zero)
        return converter.plunger_mass * converter.acceleration(plunger, zero, zero, zero, zero)

    below, above = (-float(jax.grad(force)(jnp.asarray(lift))) for lift in (-1e-4, 1e-4))
    return Found(below, {"above": f"{above:g}"})


_row = functools.partial(Row, section="2.2.1 Electro-pneumatic pressure converter")

ROWS = (
    _row(
        id="coil-direction",
        kind=Kind.IDENTITY,
        quantity="direction of the magnetic force, up counted positive",
        where="section 2.2.1, (2.3), (2.4)",
        printed="downwards: -1",
        unit="",
        rule=Near(-1.0, 0.0),
        ours=_coil_direction,
        reason="(2.3) prints x_t - x_p, with which the inductance grows upwards and the coil pushes up; with x_t + "
        "x_p it is {corrected}.",
    ),
    _row(
        id="coil-force",
        kind=Kind.IDENTITY,
        quantity="force by virtual work over force by (2.6)",
        where="(2.4), (2.6)",
        printed="1: two forms of one force",
        unit="",
        rule=Near(1.0, 1e-9),
        ours=_coil_energy,
        reason="Consistent for any coil when mu_c = mu_r mu_0.",
    ),
    _row(
        id="coil-curves",
        kind=Kind.RESULT,
        quantity="magnetic force over voltage for constant inductance",
        where="Figure 2.7",
        printed="curves",
        unit="N at full duty",
        rule=None,
        ours=_full_duty,
        reason="The polynomial has {ours} N there. A constant inductance and i = U/R make a force that goes with the "
        "square of the duty, which misses the polynomial by up to {square} N.",
        missing="turns, cross-section, permeability and resistance of the coil",
    ),
    _row(
        id="force-digits",
        kind=Kind.IDENTITY,
        quantity="largest difference of the two prints of the polynomial",
        where="(2.9), (B.1)",
        printed="the same polynomial",
        unit="mN",
        rule=Between(0.0, 5.0),
        ours=_rounding,
        reason="At {duty} % duty, worth {mbar} mbar of chamber pressure: rounding of (2.9).",
    ),
    _row(
        id="force-last-digit",
        kind=Kind.IDENTITY,
        quantity="what half of the last digit of 0.0039 is worth at full duty",
        where="(2.9), (B.1), section 2.3",
        printed="static errors within 10 mbar",
        unit="mbar",
        rule=Between(0.0, 10.0),
        ours=_last_digit,
        reason="Both prints give this coefficient two digits; half of the last one is {newton} N at 100 %, so that "
        "the printed digits can't promise the printed accuracy.",
    ),
    _row(
        id="closed-balance",
        kind=Kind.IDENTITY,
        quantity="simulated steady pressure at 50, 80 and 100 % less that of the balance",
        where="(2.8)",
        printed="0: in equilibrium no air flows",
        unit="mbar",
        rule=Near(0.0, 1.0),
        ours=_steady_pressure,
        reason="The simulated chamber settles at {levels} mbar gauge, where our equations, (2.8) among them, have "
        "their fixed point.",
    ),
    _row(
        id="plunger-stiffness",
        kind=Kind.IDENTITY,
        quantity="stiffness that holds the plunger below its closed position",
        where="(2.10), (2.58)",
        printed="k_mem + k_s1 = 4400 N/m at any position",
        unit="N/m",
        rule=Near(4400.0, 0.5),
        ours=_stiffness,
        reason="Section 2.2.1 says that the spring acts only when the plunger moves up, where {above} N/m act; while "
        "air is evacuated the membrane's {ours} N/m act alone.",
    ),
)
