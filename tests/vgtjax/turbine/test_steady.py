"""Steady flow against closed forms, another method's solution, conservation and differences."""

import dataclasses
import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import vgtjax
from vgtjax.turbine import Gas, Nozzle, Passage, PassageFlow, steady

from .ducts import CELLS, duct, plenum, solve

GAS = Gas()
NOZZLE_CELLS = 224


def turbine(vane_angle=30.0, speed=12000.0) -> Passage:
    """The default nozzle with friction that is the loss over the chord, as another method has solved it."""
    passage = Nozzle().passage(np.radians(vane_angle), speed, NOZZLE_CELLS)
    friction = np.select([passage.row == 1, passage.row == 2], [0.08 / 14.6e-3, 0.25 / (1.6 * 18e-3)], 0.0)
    return eqx.tree_at(lambda each: each.friction, passage, jnp.asarray(friction))


@pytest.fixture(scope="module")
def mid() -> PassageFlow:
    return solve(turbine(), Nozzle().inlet(2e5, 900.0), 1.05e5, GAS)


def mach(flow: PassageFlow) -> np.ndarray:
    return np.asarray(flow.v_m / GAS.sound_speed(flow.temperature))


def test_fanno_line():
    """Friction over a length is the difference of Fanno's function of the Mach number, end to end."""
    flow = solve(duct(friction=0.8), plenum(), 1.5e5, GAS)
    assert bool(flow.converged)
    gamma = GAS.gamma

    def fanno(m):
        return (1 - m**2) / (gamma * m**2) + (gamma + 1) / (2 * gamma) * np.log(
            (gamma + 1) * m**2 / (2 + (gamma - 1) * m**2)
        )

    first, last = mach(flow)[[0, -1]]
    # Second order: at 64 cells 2e-5 of it.
    np.testing.assert_allclose(fanno(first) - fanno(last), 0.8 * (flow.m[-1] - flow.m[0]), rtol=1e-4)


def test_free_vortex():
    """Without blades swirl, enthalpy and entropy stay: at every radius an algebraic equation for the velocity."""
    passage, inlet = duct(radius=(0.04, 0.02), area=(1.6336e-3, 0.8168e-3), length=0.02), plenum(tangent=2.0)
    flow = solve(passage, inlet, 1.6e5, GAS)
    swirl = np.asarray(flow.v_u * passage.centre_radius)
    # K is carried, not balanced against anything.
    np.testing.assert_allclose(swirl, swirl[0], rtol=1e-10)
    area = 0.5 * (passage.area[1:] + passage.area[:-1])
    for cell in (5, 30, 60):

        def excess(velocity, cell=cell):
            kinetic = 0.5 * (velocity**2 + (swirl[cell] / passage.centre_radius[cell]) ** 2)
            ratio = 1 - kinetic / (GAS.heat_capacity * 900.0)
            density = 2e5 / (GAS.constant * 900.0) * ratio ** (1 / (GAS.gamma - 1))
            return float(density * velocity * area[cell] - flow.mass_flow)

        # Second order: at 64 cells 3e-5 of it.
        assert float(flow.v_m[cell]) == pytest.approx(brentq(excess, 10.0, 300.0), rel=2e-4)


def test_heat_raises_total_enthalpy():
    flow = solve(duct(heat=6e7), plenum(), 1.5e5, GAS)
    enthalpy = GAS.heat_capacity * flow.temperature + 0.5 * flow.v_m**2
    given = 6e7 * 1e-3 * (flow.m[-1] - flow.m[0]) / flow.mass_flow
    # Between the middles of the first and the last cell; 4e-6 at 64 cells.
    np.testing.assert_allclose(enthalpy[-1] - enthalpy[0], given, rtol=1e-4)


def heated_pump(heat) -> Passage:
    """A wheel with radial blades and friction, and heat in W/m3 in every cell."""
    passage = duct(length=0.1, friction=0.8)
    inside = (np.asarray(passage.centres) > 0.03) & (np.asarray(passage.centres) < 0.07)
    row, length, speed = inside.astype(int), np.where(inside, 0.004, 1.0), np.where(inside, 2000.0, 0.0)
    return dataclasses.replace(passage, row=row, length=length, speed=speed, heat=heat)


def told(flow):
    """Mass flow, power, and states in the middle and at the end, in sizes near one."""
    return jnp.stack([flow.mass_flow * 10, flow.power / 1e3, flow.pressure[40] / 1e5, flow.temperature[-1] / 900])


def test_derivatives_with_respect_to_heat():
    """Of every cell, in both modes, where it is warmed, and where it is cooled as much."""
    ways = np.random.default_rng(0).normal(size=(3, CELLS))

    @jax.jit
    def slopes(heat):
        _, derivative = jax.linearize(lambda heat: told(steady(heated_pump(heat), plenum(), 1.9e5, GAS)), heat)
        (reverse,) = jax.vmap(jax.linear_transpose(derivative, heat))(jnp.eye(4))
        return jax.vmap(derivative)(jnp.asarray(ways)).T, reverse

    for sign in (1.0, -1.0):
        heat, step = sign * 6e7 * np.linspace(0.5, 1.5, CELLS), 1e5
        forward, reverse = (np.asarray(each) for each in slopes(jnp.asarray(heat)))
        assert np.all(reverse != 0)

        def moved(times, way, heat=heat, step=step):
            flow = solve(heated_pump(heat + times * step * way), plenum(), 1.9e5, GAS)
            assert bool(flow.converged)
            return np.asarray(told(flow))

        differences = [
            (8 * (moved(1, way) - moved(-1, way)) - (moved(2, way) - moved(-2, way))) / (12 * step) for way in ways
        ]
        # Steady states are found to 1e-12, which this step, some thousandth of the heat, makes 1e-9.
        np.testing.assert_allclose(forward, np.transpose(differences), rtol=1e-6)
        np.testing.assert_allclose(reverse @ ways.T, forward, rtol=1e-9)  # rounding


def test_turbine_as_another_method_has_solved_it(mid):
    """Marched ordinary differential equations with a root for continuity gave these."""
    assert bool(mid.converged)
    # 224 cells: 0.1 % of flow and 1 % of moment is what second order leaves.
    assert float(mid.mass_flow) == pytest.approx(0.09022738709597984, rel=1e-3)
    assert float(mid.power) == pytest.approx(8830.837813875643, rel=2e-3)
    moment, _ = Nozzle().vane_moment(turbine(), mid)
    assert float(moment) == pytest.approx(0.01268, rel=1e-2)


def test_conservation(mid):
    passage = turbine()
    swirl = np.asarray(mid.v_u * passage.centre_radius)
    enthalpy = np.asarray(GAS.heat_capacity * mid.temperature + 0.5 * (mid.v_m**2 + mid.v_u**2))
    # The volute carries swirl and enthalpy unchanged, to rounding times the cells.
    np.testing.assert_allclose(swirl[:32], swirl[0], rtol=1e-10)
    np.testing.assert_allclose(enthalpy[:96], enthalpy[0], rtol=5e-4)  # of means over cells; what passes faces is exact
    torque = -np.sum((mid.blade_force * passage.centre_radius)[120:208])
    drag = 0.5 * mid.density * passage.friction * np.hypot(mid.v_m, mid.v_u - passage.speed * passage.centre_radius)
    relative = mid.v_u - passage.speed * passage.centre_radius
    torque += np.sum((drag * relative * passage.volume * passage.centre_radius)[120:208])
    np.testing.assert_allclose(mid.power, 12000.0 * torque, rtol=1e-9)
    # Euler's turbine equation between the cells beside the wheel.
    np.testing.assert_allclose(mid.power, mid.mass_flow * 12000.0 * (swirl[118] - swirl[209]), rtol=1e-10)


def test_no_pressure_no_flow():
    flow = solve(duct(), plenum(), 2e5, GAS)
    assert bool(flow.converged)
    assert abs(float(flow.mass_flow)) < 1e-5


def test_a_choked_exit_does_not_feel_the_outlet():
    def passed(outlet):
        return steady(duct(area=(2e-3, 1e-3)), plenum(), outlet, GAS).mass_flow

    # Far below the critical pressure of 1.08 bar.
    assert float(jax.jit(jax.grad(passed))(6e4)) == 0.0


def test_a_search_that_fails_says_how_far_it_came():
    """A duct that would take away more heat than the gas brings along."""
    flow = solve(duct(heat=-1e9), plenum(), 1.5e5, GAS)
    assert not bool(flow.converged)
    assert 0 <= float(flow.ending.reached) < 1
    assert not float(flow.ending.imbalance) < 1e-11  # large, or no number
    # Easier ones are found.
    easier = solve(duct(heat=-6e7), plenum(), 1.5e5, GAS)
    assert float(easier.ending.reached) == 1.0
    assert float(easier.ending.imbalance) < 1e-11


def test_in_single_precision_it_is_the_same_flow():
    def single(tree):
        return jax.tree.map(lambda leaf: leaf.astype(jnp.float32) if eqx.is_inexact_array(leaf) else leaf, tree)

    nozzle, angle = single(Nozzle()), jnp.asarray(np.radians(30.0), jnp.float32)
    passage = nozzle.passage(angle, jnp.asarray(12000.0, jnp.float32), 56)
    assert {leaf.dtype for leaf in jax.tree.leaves(passage) if eqx.is_inexact_array(leaf)} == {jnp.dtype(jnp.float32)}
    flow = steady(passage, single(Nozzle().inlet(2e5, 900.0)), jnp.asarray(1.05e5, jnp.float32), single(GAS))
    double = steady(Nozzle().passage(np.radians(30.0), 12000.0, 56), Nozzle().inlet(2e5, 900.0), 1.05e5, GAS)
    assert bool(flow.converged)
    assert flow.pressure.dtype == jnp.float32
    # The imbalance that single precision leaves.
    np.testing.assert_allclose(flow.pressure, double.pressure, rtol=1e-4)
    mixed = steady(passage, Nozzle().inlet(2e5, 900.0), 1.05e5, GAS)
    assert float(mixed.mass_flow) == pytest.approx(float(double.mass_flow), rel=1e-5)


def test_bad_passages():
    good = duct()
    with pytest.raises(vgtjax.InputError, match=r"passage\.area must be areas in m2 above zero, but entry 0 is -1"):
        Passage(good.m, good.radius, -np.ones(CELLS + 1), *[getattr(good, n) for n in REST])
    with pytest.raises(vgtjax.InputError, match=r"shape is \(60,\); faces have one more than cells"):
        Passage(*[each[5:] for each in (good.m, good.radius, good.area)], *[getattr(good, n) for n in REST])
    with pytest.raises(vgtjax.InputError, match="specific gas constant"):
        Gas(constant=0.0)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"pressure": -2e5}, "inlet.total_pressure must be a positive pressure in Pa absolute, but it is -200000.0"),
        ({"temperature": np.nan}, "inlet.total_temperature must be a positive temperature in K, but it is nan"),
        ({"tangent": np.nan}, "inlet.tangent must be a finite tangent of an angle, but it is nan"),
    ],
)
def test_bad_gas_at_the_inlet(values, sentence):
    with pytest.raises(vgtjax.InputError, match=f"^{re.escape(sentence)}; correct it$"):
        plenum(**values)


@pytest.mark.parametrize("outlet", [-1e5, 0.0, np.nan, np.inf])
def test_a_pressure_that_no_outlet_has(outlet):
    with pytest.raises(vgtjax.InputError, match=f"^outlet_pressure must be a positive .* but it is {outlet}; correct"):
        steady(duct(), plenum(), outlet, GAS)


def test_a_gas_without_a_constant():
    sentence = "the parameter r in J/(kg K) must be a number, or an array of numbers, but it is None; give one"
    with pytest.raises(vgtjax.InputError, match=f"^{re.escape(sentence)}$"):
        Gas(constant=None)


REST = ("row", "tangent", "length", "speed", "friction", "heat")
