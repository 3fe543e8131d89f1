"""Chambers: heat of the wall between the adiabatic and the isothermal limit, and conservation in each."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax import Actuator, Air, FixedStep, IsothermalChamber, WallChamber, replace_parameters, simulate
from vgtjax.parts import Flow, GasState
from vgtjax.parts.chamber._base import DEAD_VOLUME

AIR = Air()
TRACE = duty_trace((0, 0.05), (90, 0.35), (35, 0.3), (60, 0.3), (0, 0.5), p_res=2.0e4)
CHAMBERS = {
    "adiabatic": vgtjax.AdiabaticChamber(),
    "wall": WallChamber(wall_conductance=0.1),
    "isothermal": IsothermalChamber(),
}


@pytest.fixture(scope="module")
def runs():
    return {name: simulate(Actuator(chamber=chamber), TRACE) for name, chamber in CHAMBERS.items()}


def test_a_wall_without_conductance_is_adiabatic(runs):
    """What it adds is zero, number for number."""
    run = simulate(Actuator(chamber=WallChamber()), TRACE)
    for name, signal in runs["adiabatic"].signals.items():
        np.testing.assert_allclose(run.signals[name], signal, rtol=1e-9, atol=1e-13, err_msg=name)


@pytest.mark.parametrize("conductance", [1e3, 1e6, 1e12])
def test_a_wall_that_conducts_everything_is_isothermal(conductance, runs):
    """At default steps; the gas lags by the inverse of the conductance and by `fastest_exchange`."""
    run = simulate(Actuator(chamber=WallChamber(wall_conductance=conductance)), TRACE)
    assert rms(run.p_act - runs["isothermal"].p_act) < 2e5 / conductance + 0.5
    assert rms(run.T_act - 293.15) < 1e3 / conductance + 1e-3


def test_more_conductance_means_less_cold(runs):
    coldest = [
        float(simulate(Actuator(chamber=WallChamber(wall_conductance=value)), TRACE).T_act.min())
        for value in (0.0, 0.03, 0.1, 0.3, 10.0, 1000.0)
    ]
    assert coldest == sorted(coldest)
    assert coldest[0] == pytest.approx(float(runs["adiabatic"].T_act.min()))
    assert coldest[-1] > 292


def test_full_duty_cools_to_206_K_or_not_at_all():
    trace = duty_trace((0, 0.05), (100, 3.0), p_res=2.0e4)
    final = {name: simulate(Actuator(chamber=chamber), trace) for name, chamber in CHAMBERS.items()}
    assert final["adiabatic"].T_act[-1] == pytest.approx(206.5, abs=0.5)
    assert 280 < final["wall"].T_act[-1] < 293.15
    np.testing.assert_array_equal(final["isothermal"].T_act, 293.15)


@pytest.mark.parametrize("name", CHAMBERS)
def test_mass_in_the_chamber_is_what_flowed_in(name):
    """Gas law against the integral of the flows; the residual is the trapezoidal rule at 0.1 ms."""
    trace = duty_trace((0, 0.05), (90, 0.35), (35, 0.3), (0, 0.3), interval=1e-4, p_res=2.0e4)
    run = simulate(Actuator(chamber=CHAMBERS[name]), trace)
    volume = 60e-6 - 2.9224e-3 * np.asarray(run.x_d)
    mass = np.asarray(run.p_act) * volume / (286.7 * np.asarray(run.T_act))
    net = np.asarray(run.m_dot_in - run.m_dot_out)
    flowed = np.concatenate([[0.0], np.cumsum(0.5 * (net[1:] + net[:-1]) * 1e-4)])
    assert rms(mass - mass[0] - flowed) < 2e-4 * np.ptp(mass)


def test_energy_of_the_gas_balances_enthalpy_work_and_heat():
    """`d(m c_v T) = c_p T_in dm_in - c_p T dm_out + p A_d dx + h A (T_wall - T) dt`."""
    trace = duty_trace((0, 0.05), (90, 0.35), (35, 0.3), (0, 0.3), interval=1e-4, p_res=2.0e4)
    run = simulate(Actuator(chamber=WallChamber(wall_conductance=0.3, wall_temperature=310.0)), trace)
    pressure, temperature, position = (np.asarray(signal) for signal in (run.p_act, run.T_act, run.x_d))
    energy = pressure * (60e-6 - 2.9224e-3 * position) / 0.396
    inward = np.asarray(run.m_dot_in - run.m_dot_out)
    carried = inward * 1.396 * 286.7 / 0.396 * np.where(inward > 0, 293.15, temperature)
    heat = 0.3 * (310.0 - temperature)
    power = carried + pressure * 2.9224e-3 * np.asarray(run.v_d) + heat
    balance = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * 1e-4)])
    assert rms(energy - energy[0] - balance) < 2e-4 * np.ptp(energy)
    assert rms(heat) > 0.1 * rms(power), "the heat would not matter"


@pytest.mark.parametrize("conductance", [0.05, 1.0, 1e9])
def test_gas_that_is_shut_in_takes_on_the_wall(conductance):
    """`T` decays with `h A / (m c_v)`, no faster than `fastest_exchange`; `p / T` stays."""
    chamber = WallChamber(wall_conductance=conductance, wall_temperature=330.0)
    gas = GasState(jnp.asarray(5.0e4), jnp.asarray(250.0))
    none = Flow(jnp.asarray(0.0), jnp.asarray(250.0))
    rates = chamber.rates(AIR, gas, none, jnp.asarray(1e-5), jnp.asarray(0.0))
    capacity = 5.0e4 * 5e-5 / (0.396 * 250.0)
    expected = min(conductance / capacity, 3e3)
    assert rates.temperature == pytest.approx(expected * 80.0)
    assert rates.pressure / 5.0e4 == pytest.approx(float(rates.temperature) / 250.0)
    assert chamber.relaxation(AIR, gas, jnp.asarray(1e-5)).temperature == pytest.approx(expected)


def test_the_bound_on_the_exchange_changes_nothing_that_is_real():
    """Up to 50 W/K, a hundred times what still air gives; and in the limit only the way there."""

    def run(conductance, bound):
        chamber = WallChamber(wall_conductance=conductance, fastest_exchange=bound)
        return simulate(Actuator(chamber=chamber), TRACE, stepping=FixedStep(max_step=5e-5)).p_act

    assert rms(run(30.0, 3e3) - run(30.0, 3e4)) < 1e-6
    assert rms(run(1e3, 3e3) - run(1e3, 3e4)) < 1.0


def test_isothermal_pressure_moves_by_gamma_less():
    """Erratum 9: gas that enters at the temperature of the chamber, and compression without flow."""
    gas = GasState(jnp.asarray(8.0e4), AIR.temperature)
    for flow, displacement in ((2e-4, 0.0), (-2e-4, 0.0), (0.0, 1e-5)):
        isothermal, adiabatic = (
            CHAMBERS[name].rates(AIR, gas, Flow(jnp.asarray(flow), AIR.temperature), jnp.asarray(1e-5), displacement)
            for name in ("isothermal", "adiabatic")
        )
        assert adiabatic.pressure == pytest.approx(1.396 * float(isothermal.pressure))
        assert isothermal.temperature == 0
        assert (isothermal.pressure > 0) == (flow + displacement > 0), "erratum"


def test_isothermal_is_slower_unless_its_orifices_are_gamma_larger():
    """Erratum 9: areas that are identified without gamma make up for it, at first exactly."""

    def run(chamber, scale):
        model = Actuator(chamber=chamber)
        names = ("converter.reservoir_orifice_slope", "converter.atmosphere_orifice")
        changed = {name: scale * vgtjax.get_parameter(model, name) for name in names}
        return simulate(replace_parameters(model, changed), duty_trace((0, 0.05), (80, 0.3), p_res=2.0e4))

    adiabatic, slow, fair = (
        run(CHAMBERS["adiabatic"], 1.0),
        run(CHAMBERS["isothermal"], 1.0),
        run(CHAMBERS["isothermal"], 1.396),
    )
    early = slice(52, 75)
    fallen = [np.asarray(101013 - each.p_act)[early] for each in (adiabatic, slow, fair)]
    assert np.all(fallen[1] < fallen[0])
    assert abs(fallen[2] / fallen[0] - 1).max() < 0.1 < abs(fallen[1] / fallen[0] - 1).max()


def test_the_derivative_by_the_conductance_is_there_without_conductance():
    """One-sided: a milliwatt per kelvin, whose own effect on the derivative is of the order of 1 %."""
    model = Actuator(chamber=WallChamber())

    def pressure(conductance):
        return simulate(replace_parameters(model, {"chamber.wall_conductance": conductance}), TRACE, throw=False).p_act

    slope = np.asarray(jax.jit(jax.jacfwd(pressure))(0.0))
    difference = np.asarray(pressure(1e-5) - pressure(0.0)) / 1e-5
    assert rms(slope) > 1e3
    assert rms(slope - difference) < 2e-3 * rms(slope)


def test_walls_refuse_settings_that_are_none():
    with pytest.raises(vgtjax.InputError, match="fastest_exchange must be a positive rate in 1/s, but it is 0"):
        WallChamber(fastest_exchange=0)


@pytest.mark.parametrize("share", [0.0, 0.3, 1 - 1e-9, 1 + 1e-9, 20.0, -0.5])
def test_the_volume_that_is_left_shrinks_as_its_slope_says(share):
    """On either side of where the diaphragm comes to the bottom, and past it; `share` is of twice the dead volume."""
    chamber = vgtjax.AdiabaticChamber()
    displaced = chamber.volume - share * 2 * DEAD_VOLUME
    volume, slope = jax.value_and_grad(chamber.gas_volume)(jnp.asarray(displaced))
    assert volume >= DEAD_VOLUME
    assert -slope == pytest.approx(float(chamber.shrinking(displaced, 1.0)), abs=1e-6)
    if share > 1:
        assert volume == chamber.volume - displaced


def test_a_diaphragm_that_sweeps_its_chamber_twice_has_none():
    chamber = vgtjax.AdiabaticChamber()
    assert np.isfinite(chamber.gas_volume(jnp.asarray(1.9 * chamber.volume)))
    assert np.isnan(chamber.gas_volume(jnp.asarray(2.1 * chamber.volume)))


def test_gas_that_a_diaphragm_squeezes_out_comes_back_as_it_was():
    """To the bottom and back without flow: an adiabat, p V^gamma."""
    chamber, none = vgtjax.AdiabaticChamber(), Flow(jnp.asarray(0.0), jnp.asarray(293.15))
    way = np.linspace(chamber.volume - 4e-6, chamber.volume + 2e-7, 4001)
    gas, seen = np.array([2e4, 250.0]), []
    rates = jax.jit(lambda gas, displaced: chamber.rates(AIR, GasState(*gas), none, displaced, jnp.asarray(1.0)))
    for begin, end in itertools.pairwise(way):
        middle, step = (begin + end) / 2, end - begin
        slope = np.array(jax.tree.leaves(rates(gas, begin)))
        gas = gas + step * np.array(jax.tree.leaves(rates(gas + 0.5 * step * slope, middle)))
        seen.append(gas[0] * float(chamber.gas_volume(end)) ** AIR.heat_capacity_ratio)
    expected = 2e4 * 4e-6**AIR.heat_capacity_ratio
    np.testing.assert_allclose(seen, expected, rtol=1e-5)  # of midpoint steps of a nanolitre
