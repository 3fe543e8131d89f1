"""Statements on the tube between converter and chamber [2.16-2.32]."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax import DelayLine
from vgtjax.parts import TURBULENT as BLASIUS, GasState, friction_rate, speed_of_sound

from . import experiments
from .rows import Between, Found, Kind, Near, Row

TURBULENT = 4000.0
"""Reynolds number above which the thesis calls the flow turbulent."""


def tube() -> DelayLine:
    """A tube of assumed length, bore and viscosity; the thesis prints none of them."""
    return DelayLine()


def _assumed() -> dict[str, float | str]:
    return {"length": f"{float(tube().length):g}", "bore": f"{1e3 * float(tube().bore):g}"}


def _delay_seconds() -> float:
    return float(tube().length / speed_of_sound(experiments.actuator().air))


def _evacuation() -> vgtjax.Solution:
    return experiments.duty_pulse(100.0)


def _peak_reynolds() -> Found:
    flow, viscosity = float(_evacuation().m_dot_out.max()), float(tube().viscosity)
    widest = 4 * flow / (math.pi * TURBULENT * viscosity)
    number = 4 * flow / (math.pi * float(tube().bore) * viscosity)
    return Found(number, {**_assumed(), "widest": f"{1e3 * widest:.1f}"})


def _blasius() -> Found:
    """`R_t D^2 / (mu Re^(3/4))` from the pressure drop `f rho v^2 / (2 D)` a length, at any flow."""
    density, velocity, bore, viscosity = 1.2, 20.0, 4e-3, 1.81e-5
    number = density * velocity * bore / viscosity
    drop = 0.316 / number**0.25 * density * velocity**2 / (2 * bore)
    return Found(drop / velocity * bore**2 / (viscosity * number**0.75), {"used": f"{BLASIUS:g}"})


def _exponents(column: str) -> np.ndarray:
    """Exponent of the attenuation [2.29] while full duty evacuates the chamber, or while its release fills it."""
    solution, air = _evacuation(), experiments.actuator().air
    flow = np.asarray(getattr(solution, column))
    matters = flow > 0.1 * flow.max()
    state = (jnp.asarray(np.asarray(signal)[matters]) for signal in (flow, solution.p_act, solution.T_act))
    rate = jax.vmap(lambda m, p, t: friction_rate(air, GasState(p, t), m, tube().bore, tube().viscosity))
    return np.asarray(0.5 * rate(*state) * _delay_seconds())


def _attenuation() -> Found:
    evacuating, filling = (100 * (1 - np.exp(-_exponents(column))) for column in ("m_dot_out", "m_dot_in"))
    facts = {**_assumed(), "filling": f"{filling.max():.0f}"}
    return Found((float(evacuating.min()), float(evacuating.max())), facts)


def _delay() -> Found:
    speed = float(speed_of_sound(experiments.actuator().air))
    return Found(1e3 * _delay_seconds(), {**_assumed(), "speed": f"{speed:.0f}"})


def _dispersion() -> Found:
    """The neglected term of (2.26) over the wave term, for the tube's slowest wave, in percent."""
    slowest = math.pi / 2
    return Found(100 * float(np.max(_exponents("m_dot_out")) / slowest) ** 2)


_row = functools.partial(Row, section="2.2.2 Air mass flow: the tube")
_SIZE = "length and bore of the tube"

ROWS = (
    _row(
        id="line-blasius",
        kind=Kind.IDENTITY,
        quantity="factor of the tube's resistance",
        where="(2.30), (2.31)",
        printed="0.158",
        unit="",
        rule=Near(0.158, 0.0005),
        ours=_blasius,
        reason="Half of Blasius' 0.316, whatever flow and bore; we compute with {used}.",
    ),
    _row(
        id="line-reynolds",
        kind=Kind.OWN_INPUTS,
        quantity="largest Reynolds number at full duty",
        where="section 2.2.2",
        printed="above 4000: the flow is turbulent",
        unit="",
        rule=Between(TURBULENT, math.inf),
        ours=_peak_reynolds,
        reason="Through an assumed bore of {bore} mm it peaks at {ours}; in a bore above {widest} mm the flow never "
        "reaches 4000.",
        missing=_SIZE,
    ),
    _row(
        id="line-delay",
        kind=Kind.OWN_INPUTS,
        quantity="delay of the flow",
        where="(2.28), (2.29)",
        printed="L/c",
        unit="ms",
        rule=None,
        ours=_delay,
        reason="For an assumed {length} m at {speed} m/s it is {ours} ms, short against every response time of "
        "section 2.3.",
        missing=_SIZE,
    ),
    _row(
        id="line-attenuation",
        kind=Kind.OWN_INPUTS,
        quantity="attenuation of the flow at full duty, least and most",
        where="(2.29), (2.31), (2.32)",
        printed="exp(-R_t R T/(2 p) L/c)",
        unit="% lost",
        rule=None,
        ours=_attenuation,
        reason="For an assumed {length} m of {bore} mm; up to {filling} % when full duty is released. The print loses "
        "this share of a steady flow as well, whose mass must be conserved.",
        missing=_SIZE,
    ),
    _row(
        id="line-dispersion",
        kind=Kind.OWN_INPUTS,
        quantity="neglected dispersion over the wave term, slowest wave of the tube",
        where="(2.26), (2.27)",
        printed="very small",
        unit="%",
        rule=Between(0.0, 1.0),
        ours=_dispersion,
        reason="In the assumed tube it may be neglected indeed; (2.26) lacks a minus before its last factor.",
        missing=_SIZE,
    ),
)
