"""Statements on compressible flow and orifice areas [2.13-2.15, 2.33, B.2, B.3]."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import vgtjax

from . import experiments
from .rows import Between, Found, Kind, Near, Row

DIATOMIC = 1.4
"""Heat capacity ratio of air in textbooks."""
MM2 = 1e6
"""mm2 in a m2."""


def printed_phi(gamma: float, ratio: np.ndarray, choked_root: int) -> np.ndarray:
    """Phi as (2.15) or (2.58) print it: `2/(gamma-1)` outside the root, the choked value under `choked_root` roots."""
    with np.errstate(invalid="ignore"):
        subsonic = np.sqrt(ratio ** (2 / gamma) - ratio ** ((gamma + 1) / gamma)) * 2 / (gamma - 1)
    choked = (2 / (gamma + 1)) ** ((gamma + 1) / (gamma - 1) / 2**choked_root)
    return np.where(ratio > critical_ratio(gamma), subsonic, choked)


def critical_ratio(gamma: float) -> float:
    """Pressure ratio below which flow is choked [2.15]."""
    air = vgtjax.Air(heat_capacity_ratio=gamma)
    return float(air.critical_ratio())


def curves() -> list[tuple[np.ndarray, np.ndarray]]:
    """Pressure ratios and Phi: corrected, as (2.15) prints it, as (2.58) prints it."""
    ratio = np.linspace(0.0, 1.0, 501)
    ours = np.asarray(vgtjax.flow_function(vgtjax.Air(), jnp.asarray(ratio)))
    return [(ratio, ours), *((ratio, printed_phi(_gamma(), ratio, root)) for root in (1, 2))]


def _gamma() -> float:
    return float(vgtjax.Air().heat_capacity_ratio)


def _critical_ratio() -> Found:
    return Found(critical_ratio(_gamma()), {"gamma": _gamma(), "diatomic": critical_ratio(DIATOMIC)})


def _jump(choked_root: int) -> Found:
    """Jump of the printed Phi at the critical ratio in percent of its choked value."""
    at = critical_ratio(_gamma())
    choked, subsonic = printed_phi(_gamma(), np.array([at, np.nextafter(at, 1.0)]), choked_root)
    return Found(100 * float(subsonic / choked - 1), {"choked": f"{choked:.4f}", "subsonic": f"{subsonic:.4f}"})


def _jump_of_ours() -> Found:
    air = vgtjax.Air()
    at = air.critical_ratio()
    choked, above = (float(vgtjax.flow_function(air, at + shift)) for shift in (0.0, 1e-9))
    return Found(100 * (above / choked - 1), {"choked": f"{choked:.4f}"})


def _sonic() -> Found:
    """Mach number in the throat of a choked orifice, from the choked value of Phi."""
    air = vgtjax.Air()
    gamma = _gamma()
    # Flow per area through a throat at Mach M is p sqrt(gamma/(R T)) M (1 + (gamma-1)/2 M^2)^(-(gamma+1)/(2(gamma-1))).
    mach = np.linspace(0.2, 1.8, 160001)
    flow = mach * (1 + (gamma - 1) / 2 * mach**2) ** (-(gamma + 1) / (2 * (gamma - 1)))
    choked = _choked(air)
    return Found(float(mach[np.argmax(flow)]), {"choked": f"{choked:.5f}", "largest": f"{flow.max():.5f}"})


def _saturated_area() -> float:
    area = experiments.actuator().converter.orifice_area(jnp.asarray(-5e-3))
    return MM2 * float(area)


def _leak() -> Found:
    """Area of the atmosphere orifice just above rest, and how much of a typical opening that is."""
    converter = experiments.actuator().converter
    areas = jax.vmap(converter.orifice_area)(jnp.asarray([2 * converter.opening_width, 1e-3]))
    rest, opened = (MM2 * float(area) for area in areas)
    return Found(rest, {"percent": f"{100 * rest / opened:.1f}"})


def _area_by_isotherm() -> Found:
    """Area that (2.33) makes of the simulated evacuation, over the area that was simulated."""
    run, model = experiments.duty_pulse(100.0), experiments.actuator()
    air, pressure, temperature = model.air, np.asarray(run.p_act), np.asarray(run.T_act)
    # After the plunger has moved and before the diaphragm does, with the flow choked: volume and Phi are constant.
    window = (np.asarray(run.time) > 0.02) & (np.asarray(run.time) < 0.04)
    rate = np.gradient(pressure, np.asarray(run.time))
    upstream = np.sqrt(temperature / (air.gas_constant * air.heat_capacity_ratio)) / (pressure * _choked(air))
    found = -rate * float(model.chamber.volume) / temperature * upstream
    true = jax.vmap(model.converter.orifice_area)(run.x_p)
    return Found(float(np.mean((found / np.asarray(true))[window])), {"gamma": f"{_gamma():g}"})


def _choked(air: vgtjax.Air) -> float:
    return float(vgtjax.flow_function(air, jnp.asarray(0.3)))


_flow = functools.partial(Row, section="2.2.2 Air mass flow")
_area = functools.partial(Row, section="2.2.2.1 Effective flow area")

ROWS = (
    _flow(
        id="choked-ratio",
        kind=Kind.RESULT,
        quantity="pressure ratio at which flow is choked",
        where="section 2.2.2",
        printed="0.528",
        unit="",
        rule=Near(0.528, 0.0005),
        ours=_critical_ratio,
        reason="With the printed gamma = {gamma} (Table B.2) it is {ours}; 0.528 belongs to gamma = 1.4, which gives "
        "{diatomic:.4f}.",
    ),
    _flow(
        id="phi-as-printed",
        kind=Kind.IDENTITY,
        quantity="jump of Phi at the choked ratio, as printed",
        where="(2.15), (3.13)",
        printed="one function, no jump",
        unit="%",
        rule=Near(0.0, 0.1),
        ours=lambda: _jump(1),
        reason="With 2/(gamma-1) outside the root Phi falls from {subsonic} to {choked} where flow chokes.",
    ),
    _flow(
        id="phi-as-printed-in-the-whole",
        kind=Kind.IDENTITY,
        quantity="jump of Phi at the choked ratio, as printed in the whole model",
        where="(2.58)",
        printed="one function, no jump",
        unit="%",
        rule=Near(0.0, 0.1),
        ours=lambda: _jump(2),
        reason="Here the choked value stands under two roots besides, and Phi falls from {subsonic} to {choked}.",
    ),
    _flow(
        id="phi-corrected",
        kind=Kind.IDENTITY,
        quantity="jump of Phi with 2/(gamma-1) under the root",
        where="(2.15), (A.29)",
        printed="one function, no jump",
        unit="%",
        rule=Near(0.0, 0.1),
        ours=_jump_of_ours,
        reason="With 2/(gamma-1) under the root both branches are {choked} where they meet; this is what we use.",
    ),
    _flow(
        id="sonic-throat",
        kind=Kind.IDENTITY,
        quantity="Mach number where flow is choked",
        where="section 2.2.2",
        printed="1",
        unit="",
        rule=Near(1.0, 0.005),
        ours=_sonic,
        reason="The flow through a throat, maximised over its Mach number, peaks there with {largest}; the choked Phi "
        "is {choked}.",
    ),
    _area(
        id="reservoir-area",
        kind=Kind.IDENTITY,
        quantity="largest area towards the reservoir",
        where="(B.2)",
        printed="0.90e-6 m2",
        unit="mm2",
        rule=Near(0.90, 0.005),
        ours=_saturated_area,
        reason="Slope times saturation of (B.2); its two branches meet.",
    ),
    _area(
        id="area-by-isotherm",
        kind=Kind.IDENTITY,
        quantity="area that (2.33) finds in the evacuation, over the area that was there",
        where="(2.33), (2.57)",
        printed="1",
        unit="",
        rule=Near(1.0, 0.02),
        ours=_area_by_isotherm,
        reason="(2.33) is isothermal, the chamber of (2.57) adiabatic: applied to a simulated evacuation it finds "
        "areas that are {ours} times too large, which is gamma = {gamma} but for the open stop, which yields a little.",
    ),
    _area(
        id="closed-at-rest",
        kind=Kind.IDENTITY,
        quantity="area towards the atmosphere just above the closed position",
        where="section 2.2.2.1, (B.3)",
        printed="0: neither port is connected",
        unit="mm2",
        rule=Between(0.0, 0.001),
        ours=_leak,
        reason="The constant of (B.3), 2.299e-8 m2, is {percent} % of the area at a lift of 1 mm and opens at once "
        "where the plunger rests. We keep it and let it open over a micrometre.",
    ),
)
