"""Steady flow against closed forms: order, Rayleigh's line, shocks with swirl, a diffuser, a pump."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from vgtjax.turbine import Gas, Passage

from .ducts import duct, plenum, solve

GAS = Gas()
PRESSURE, TEMPERATURE, RADIUS = 2e5, 900.0, 0.05
AT_REST = GAS.heat_capacity * TEMPERATURE


def isentropic(velocity, swirling):
    """Density and pressure of gas from the plenum at a meridional and a circumferential velocity."""
    ratio = 1 - 0.5 * (velocity**2 + swirling**2) / AT_REST
    return PRESSURE / (287 * TEMPERATURE) * ratio ** (1 / 0.34), PRESSURE * ratio ** (1.34 / 0.34)


def subsonic(mass_flow, area, swirling):
    """Meridional velocity that passes a mass flow through an area without a loss."""
    return brentq(lambda v: isentropic(v, swirling)[0] * v * area - mass_flow, 1e-3, 400.0, xtol=1e-12)


def bulged(cells) -> Passage:
    """A duct, inwards, that narrows by a quarter and widens again."""
    passage = duct(radius=(0.05, 0.04), cells=cells)
    share = np.linspace(0, 1, cells + 1)
    return dataclasses.replace(passage, area=1e-3 * (1 - 0.25 * np.sin(np.pi * share) ** 2))


def vortex_error(cells) -> float:
    """Mean error of pressure over that in the plenum."""
    passage = bulged(cells)
    flow = solve(passage, plenum(tangent=1.0), 1.7e5, GAS)
    swirl, mass_flow = float(flow.v_u[0] * passage.centre_radius[0]), float(flow.mass_flow)
    area = np.asarray(1e-3 * (1 - 0.25 * np.sin(np.pi * np.asarray(passage.centres) / 0.5) ** 2))
    swirling = swirl / np.asarray(passage.centre_radius)
    velocity = [subsonic(mass_flow, *each) for each in zip(area, swirling, strict=True)]
    return float(np.mean(np.abs(flow.pressure - isentropic(np.array(velocity), swirling)[1])) / PRESSURE)


def fanno_error(cells) -> float:
    """Of Fanno's function over the length."""
    flow = solve(duct(friction=0.8, cells=cells), plenum(), 1.5e5, GAS)
    mach = np.asarray(flow.v_m / GAS.sound_speed(flow.temperature))[[0, -1]]
    function = (1 - mach**2) / (1.34 * mach**2) + 2.34 / 2.68 * np.log(2.34 * mach**2 / (2 + 0.34 * mach**2))
    return float(abs(function[0] - function[1] - 0.8 * (flow.m[-1] - flow.m[0])))


def rayleigh_error(cells) -> float:
    """Of the ratio of total temperatures that Mach numbers at both ends belong to."""
    flow = solve(duct(heat=6e7, cells=cells), plenum(), 1.5e5, GAS)
    mach = np.asarray(flow.v_m / GAS.sound_speed(flow.temperature))[[0, -1]]
    total = np.asarray(flow.temperature)[[0, -1]] * (1 + 0.17 * mach**2)
    heated = mach**2 * (1 + 0.17 * mach**2) / (1 + 1.34 * mach**2) ** 2
    return float(abs(heated[1] / heated[0] - total[1] / total[0]))


@pytest.mark.parametrize("error", [vortex_error, fanno_error, rayleigh_error])
def test_smooth_flow_is_of_second_order(error):
    coarse, fine = error(32), error(64)
    assert np.log2(coarse / fine) > 1.8
    assert fine < 2e-3


@pytest.mark.parametrize("tangent", [0.0, 0.6])
def test_a_shock_with_and_without_swirl(tangent):
    """Choked: the flow is that of a throat at which the meridional velocity is sonic; behind the shock total pressure
    is what the outlet's pressure needs."""
    share, still = np.linspace(0, 1, 129), np.zeros(128)
    area = 1e-3 * (1 + 4.75 * (share - 0.5) ** 2)
    passage = Passage(0.2 * share, RADIUS + 0 * share, area, still.astype(int), still, still + 1, *[still] * 3)
    outlet = 1.4e5
    flow = solve(passage, plenum(tangent=tangent), outlet, GAS)
    assert bool(flow.converged)

    def passed(inlet_velocity):
        swirling = tangent * inlet_velocity
        best = minimize_scalar(lambda v: -isentropic(v, swirling)[0] * v, bounds=(200, 600), method="bounded")
        return isentropic(inlet_velocity, swirling)[0] * inlet_velocity * area[0] + best.fun * area[64]

    velocity = brentq(passed, 10.0, 400.0)
    choked = isentropic(velocity, tangent * velocity)[0] * velocity * area[0]
    assert float(flow.mass_flow) == pytest.approx(float(choked), rel=1e-3)  # 6e-5 at 128 cells
    # Behind the shock: total enthalpy stays, so that the flow and the pressure give the velocity, and with it entropy.
    swirling = tangent * velocity

    def missing(v):
        ratio = 1 - 0.5 * (v**2 + swirling**2) / AT_REST
        return outlet / (287 * TEMPERATURE * ratio) * v * area[-1] - choked

    leaving = brentq(missing, 10.0, 500.0)
    rise = np.log(isentropic(leaving, swirling)[1] / outlet)
    entropy = (np.log(np.asarray(flow.pressure)) - 1.34 * np.log(np.asarray(flow.density))) / 0.34
    assert rise > 1e-3
    # Second order up to the shock, first behind it, and half a cell before the end.
    assert float(entropy[-1] - entropy[0]) == pytest.approx(float(rise), rel=0.03)
    assert float(np.max(np.asarray(flow.v_m / GAS.sound_speed(flow.temperature)))) > 1.1
    np.testing.assert_allclose(flow.v_u, flow.v_u[0], rtol=1e-10)  # no shock feels it


def test_a_diffuser():
    passage = duct(area=(1e-3, 2e-3))
    flow = solve(passage, plenum(), 1.9e5, GAS)
    leaving = np.sqrt(2 * AT_REST * (1 - 0.95 ** (0.34 / 1.34)))
    by_hand = isentropic(leaving, 0.0)[0] * leaving * 2e-3
    # Second order: at 64 cells 1e-4 of it.
    assert float(flow.mass_flow) == pytest.approx(float(by_hand), rel=1e-3)
    assert np.all(np.diff(flow.pressure) > 0)


def test_a_pump_against_the_pressure_behind_it():
    """A wheel with radial blades takes gas without swirl to its own speed: Euler's equation, and more pressure behind
    than before."""
    passage, speed = duct(length=0.1), 3000.0
    inside = (np.asarray(passage.centres) > 0.03) & (np.asarray(passage.centres) < 0.07)
    wheel = dataclasses.replace(
        passage,
        row=inside.astype(int),
        length=np.where(inside, 0.004, 1.0),
        speed=np.where(inside, speed, 0.0),
    )
    flow = solve(wheel, plenum(), 1.02 * PRESSURE, GAS)
    assert bool(flow.converged)
    assert float(flow.mass_flow) > 0
    swirl = np.asarray(flow.v_u * passage.centre_radius)
    # The gas has taken the wheel's speed but for exp(-10).
    assert swirl[-1] == pytest.approx(speed * RADIUS**2, rel=1e-3)
    np.testing.assert_allclose(flow.power, flow.mass_flow * speed * (swirl[0] - swirl[-1]), rtol=1e-9)
    enthalpy = np.asarray(GAS.heat_capacity * flow.temperature + 0.5 * (flow.v_m**2 + flow.v_u**2))
    # Of cells' means: second order.
    assert enthalpy[-1] - enthalpy[0] == pytest.approx(speed * swirl[-1], rel=1e-3)
