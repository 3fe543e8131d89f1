"""Statements on the chamber, and on signs of the whole model [2.39-2.58, 3.13]."""

import functools

import jax.numpy as jnp

from vgtjax.parts import Flow, GasState

from . import experiments
from .rows import Found, Kind, Near, Row


def _pressure_rate(flow: float, displacement_rate: float) -> float:
    """Rate of the chamber's pressure at ambient state in Pa/s, at a flow in kg/s and a displacement in m3/s."""
    model = experiments.actuator()
    air = model.air
    rates = model.chamber.rates(
        air,
        GasState(air.pressure, air.temperature),
        Flow(jnp.asarray(flow), air.temperature),
        jnp.zeros(()),
        jnp.asarray(displacement_rate),
    )
    return float(rates.pressure)


def _volume_sign() -> float:
    """Sign of the pressure's rate while the diaphragm takes volume from a closed chamber."""
    return float(jnp.sign(_pressure_rate(0.0, 1e-6)))


def _gamma_factor() -> float:
    """Rate of the pressure over `R T m' / V`, as (3.13) prints it."""
    air, volume = experiments.actuator().air, experiments.actuator().chamber.volume
    isothermal = float(air.gas_constant * air.temperature / volume) * 1e-5
    return _pressure_rate(1e-5, 0.0) / isothermal


def _evacuating_flow() -> float:
    """Sign of the mass rate of the chamber while full duty evacuates it."""
    solution = experiments.duty_pulse(100.0)
    early = solution.time < 0.1
    return float(jnp.sign(jnp.sum(jnp.where(early, solution.m_dot_in - solution.m_dot_out, 0.0))))


def _warm_inflow() -> Found:
    """Pressure rate when full duty is released by (2.58), with the chamber's temperature, over that by (2.57)."""
    air = experiments.actuator().air
    coldest = float(experiments.duty_pulse(100.0).T_act.min())
    return Found(
        coldest / float(air.temperature), {"coldest": f"{coldest:.0f}", "ambient": f"{float(air.temperature):g}"}
    )


_row = functools.partial(Row, section="2.2.3 Pneumatic actuator: chamber")

ROWS = (
    _row(
        id="volume-sign",
        kind=Kind.IDENTITY,
        quantity="sign of the volume term, gamma p A_d v / V",
        where="(2.56), (2.57), (2.58)",
        printed="-1",
        unit="",
        rule=Near(-1.0, 0.0),
        ours=_volume_sign,
        reason="A closed chamber that shrinks gains pressure; (3.13) has the right sign.",
    ),
    _row(
        id="pressure-gain",
        kind=Kind.IDENTITY,
        quantity="pressure rate over R T m' / V",
        where="(3.13)",
        printed="1",
        unit="",
        rule=Near(1.0, 0.001),
        ours=_gamma_factor,
        reason="(2.57) has gamma = {ours} here, as an adiabatic chamber must; (3.13) lost it.",
    ),
    _row(
        id="flow-sign",
        kind=Kind.IDENTITY,
        quantity="sign of the chamber's mass rate while it is evacuated",
        where="(3.13)",
        printed="+1",
        unit="",
        rule=Near(1.0, 0.0),
        ours=_evacuating_flow,
        reason="(3.13) swaps inflow and outflow; (2.58) has them right.",
    ),
    _row(
        id="inflow-temperature",
        kind=Kind.IDENTITY,
        quantity="pressure rate as full duty is released, by (2.58) over (2.57)",
        where="(2.57), (2.58)",
        printed="1: two forms of one equation",
        unit="",
        rule=Near(1.0, 0.01),
        ours=_warm_inflow,
        reason="(2.58) lets air of the atmosphere come in with the chamber's temperature, {coldest} K then instead of "
        "{ambient} K.",
    ),
)
