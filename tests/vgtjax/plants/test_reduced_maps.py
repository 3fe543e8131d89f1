"""Maps of the flow into the chamber: what they are fitted to, their slopes, and their inversion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import fit_flow_map
from vgtjax.parts import LiftTable, PolynomialFlow, PrintedFlow
from vgtjax.parts.flow_map._base import duty_by_bisection
from vgtjax.plants import steady_flow
from vgtjax.plants.reduced._fitting import FLOW_MAPS

ACTUATOR = vgtjax.Actuator()
OVER_DUTY = ("steady-plunger", "polynomial", "printed")
RESERVOIR = 2.0e4
SATURATED = 2.5e-3 * 2000 / 1.7425e-4
"""Pa above equilibrium at which the orifice to the reservoir is fully open."""
DUTY, PRESSURE = (
    jnp.asarray(values.ravel())
    for values in np.meshgrid(np.linspace(1.3, 99.1, 34), np.linspace(3.0e4, 1.005e5, 33), indexing="ij")
)
"""Not on the fit's own grid."""


@pytest.fixture(scope="module")
def fits():
    return {kind: fit_flow_map(ACTUATOR, kind) for kind in FLOW_MAPS}


@eqx.filter_jit
def evaluate(flow_map, *at):
    return flow_map(*at)


def slopes(flow_map, duty, pressure):
    """Derivatives with respect to duty and pressure."""
    return jax.jit(jax.vmap(jax.grad(lambda u, p: flow_map(u, p), argnums=(0, 1))))(duty, pressure)


def difference(flow_map, duty, pressure):
    """Pa above the map's equilibrium."""
    return pressure - np.polynomial.Polynomial(np.asarray(flow_map.equilibrium))(np.asarray(duty))


def test_the_steady_plungers_map_is_the_full_model_in_steady_flow(fits):
    flow_map = fits["steady-plunger"].flow_map
    exact = steady_flow(ACTUATOR, DUTY, PRESSURE, RESERVOIR)
    error = np.asarray(evaluate(flow_map, DUTY, PRESSURE)) - exact
    # A line between knots; 9e-6 kg/s was measured, on the parabola of the wide open atmosphere, of 9e-4 kg/s.
    assert np.max(np.abs(error)) < 1.2e-5
    assert np.max(np.abs(exact)) > 7e-4


def test_the_goodness_of_a_fit_is_that_of_its_map(fits):
    # Measured: 0.99987, 0.99987, 0.8301, -0.08 (B.4 is another bench's wide open atmosphere).
    assert fits["steady-plunger"].r_squared > 0.9998
    assert fits["lift-table"].r_squared > 0.9998
    assert 0.80 < fits["polynomial"].r_squared < 0.86
    assert fits["printed"].r_squared < 0.1
    for kind in OVER_DUTY:
        fit = fits[kind]
        assert fit.pressure_range == (pytest.approx(29368.2, abs=0.1), 101013.0)
        assert fit.duty_range == (0.0, 100.0)
        duty, pressure = np.meshgrid(np.linspace(0, 100, 101), np.linspace(*fit.pressure_range, 101))
        exact = steady_flow(ACTUATOR, duty, pressure, RESERVOIR)
        error = np.asarray(fit.flow_map(jnp.asarray(duty), jnp.asarray(pressure))) - exact
        # The same numbers in another order of summation.
        assert fit.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        assert fit.peak == pytest.approx(np.max(np.abs(error)), rel=1e-9)
        assert fit.pressure_rate_rmse == pytest.approx(fit.rmse * 286.7 * 293.15 / 60e-6, rel=1e-9)


def test_default_coefficients_are_those_fitted_to_the_printed_actuator(fits):
    # Ten digits are written.
    for mine, name in ((PolynomialFlow(), "polynomial"), (PrintedFlow(), "printed")):
        for leaf, fitted in zip(jax.tree.leaves(mine), jax.tree.leaves(fits[name].flow_map), strict=True):
            np.testing.assert_allclose(leaf, fitted, rtol=2e-9)


def test_the_polynomial_is_the_least_squares_one_where_no_slope_is_at_its_limit(fits):
    """The same weights without limits on the slopes: normal equations in the printed powers."""
    flow_map = fits["polynomial"].flow_map
    low, high = fits["polynomial"].pressure_range
    duty, pressure = (v.ravel() for v in np.meshgrid(np.linspace(0, 100, 101), np.linspace(low, high, 101)))
    weight = 1 / (1 + (difference(fits["printed"].flow_map, duty, pressure) / 2e4) ** 2)
    scaled = np.stack([np.ones_like(duty), pressure / 1e5, (pressure / 1e5) ** 2, duty / 1e2, (duty / 1e2) ** 2], 1)
    flow = steady_flow(ACTUATOR, duty, pressure, RESERVOIR)
    found = np.linalg.lstsq(scaled * weight[:, None], flow * weight, rcond=None)[0]
    expected = found / np.array([1, 1e5, 1e10, 1e2, 1e4])
    # Two solvers on a problem of condition 1e2.
    np.testing.assert_allclose(np.concatenate([flow_map.pressure, flow_map.duty]), expected, rtol=1e-8)


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_flow_falls_with_duty_and_pressure_where_a_map_is_valid(kind, fits):
    flow_map = fits[kind].flow_map
    inside = np.asarray(flow_map.valid(DUTY, PRESSURE))
    assert np.mean(inside) > 0.8  # of the working range
    by_duty, by_pressure = slopes(flow_map, DUTY, PRESSURE)
    assert np.all(by_pressure[inside] < 0)
    if kind == "steady-plunger":
        open_fully = difference(flow_map, DUTY, PRESSURE) > SATURATED
        assert np.all(by_duty[inside & open_fully] == 0)  # the orifice is saturated
        inside &= ~open_fully
    assert np.all(by_duty[inside] < 0)


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_a_map_inverted_for_its_own_flow_gives_the_duty_back(kind, fits):
    flow_map = fits[kind].flow_map
    steep = np.asarray(flow_map.valid(DUTY, PRESSURE)) & (np.asarray(slopes(flow_map, DUTY, PRESSURE)[0]) < -1e-8)
    duty, pressure = DUTY[steep], PRESSURE[steep]
    found = jax.jit(jax.vmap(flow_map.duty_for))(flow_map(duty, pressure), pressure)
    # Flow of 1e-4 kg/s is rounded to 1e-20; by a slope of 1e-8 that is 1e-12 %.
    np.testing.assert_allclose(found, duty, atol=1e-9)


def test_the_closed_form_is_what_bisection_finds(fits):
    flow_map = fits["polynomial"].flow_map
    flow = jnp.asarray(np.random.default_rng(0).uniform(-4e-4, 5e-4, DUTY.shape))
    closed = flow_map.duty_for(flow, PRESSURE)
    np.testing.assert_allclose(closed, duty_by_bisection(flow_map, flow, PRESSURE, None), atol=1e-9)
    assert np.any(closed == 0)
    assert np.any(closed == 100)
    assert np.mean((closed > 0) & (closed < 100)) > 0.2
    straight = PolynomialFlow(duty=(-4.5e-6, 0.0))
    assert straight.duty_for(straight(40.0, 6e4), 6e4) == pytest.approx(40.0, abs=1e-9)  # b2 = 0 needs no special case


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_a_flow_out_of_reach_gets_the_duty_at_the_end(kind, fits):
    flow_map = fits[kind].flow_map
    pressure = jnp.asarray(6e4)
    assert flow_map.duty_for(jnp.asarray(5e-2), pressure) == 0
    assert flow_map.duty_for(jnp.asarray(-5e-2), pressure) == 100
    assert jax.grad(flow_map.duty_for)(jnp.asarray(5e-2), pressure) == 0


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_no_number_gets_no_number_for_a_duty(kind, fits):
    """A duty of zero would hide from a closed loop that its controller has failed."""
    nothing, flow, pressure = jnp.asarray(jnp.nan), jnp.asarray(0.0), jnp.asarray(8.0e4)
    flow_map = fits[kind].flow_map
    assert np.isnan(flow_map.duty_for(nothing, pressure))
    assert np.isnan(flow_map.duty_for(flow, nothing))
    assert np.isnan(flow_map.working_pressure(nothing))
    assert np.isfinite(flow_map.duty_for(flow, pressure))


def test_where_the_orifice_is_saturated_any_duty_that_gives_the_flow_will_do(fits):
    flow_map, pressure = fits["steady-plunger"].flow_map, jnp.asarray(9e4)
    flow = flow_map(jnp.asarray(100.0), pressure)
    duty, slope = jax.value_and_grad(flow_map.duty_for)(flow, pressure)
    assert flow_map(duty, pressure) == pytest.approx(float(flow), rel=1e-9)
    assert slope == 0


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_derivatives_of_the_inverted_map_are_those_of_the_implicit_function(kind, fits):
    flow_map = fits[kind].flow_map
    duty, pressure = jnp.asarray(43.0), jnp.asarray(7.5e4)
    flow = flow_map(duty, pressure)
    by_duty, by_pressure = jax.grad(lambda u, p: flow_map(u, p), argnums=(0, 1))(duty, pressure)
    by_flow, along = jax.grad(flow_map.duty_for, argnums=(0, 1))(flow, pressure)
    # Rounding, through a root whose argument cancels two digits.
    assert by_flow == pytest.approx(float(1 / by_duty), rel=1e-9)
    assert along == pytest.approx(float(-by_pressure / by_duty), rel=1e-9)
    name, index = {"steady-plunger": ("equilibrium", 1), "polynomial": ("duty", 0), "printed": ("phi", 1)}[kind]
    value = getattr(flow_map, name)

    def found(coefficient):
        moved = vgtjax.replace_parameters(flow_map, {name: value.at[index].set(coefficient)})
        return moved.duty_for(flow, pressure)

    step = 1e-5 * abs(value[index])
    found = jax.jit(found)
    numeric = (found(value[index] + step) - found(value[index] - step)) / (2 * step)
    # Central differences: truncation of 1e-10 of the value, and 1e-13 % of bisection over a change of 1e-4 %.
    assert jax.grad(found)(value[index]) == pytest.approx(float(numeric), rel=1e-6)


def test_nothing_flows_at_the_converters_working_pressure(fits):
    duty = jnp.linspace(10.0, 95.0, 18)
    working = ACTUATOR.converter.working_pressure(duty, 101013.0, RESERVOIR)
    # The quartic is exact; the table is zero at its knots.
    np.testing.assert_allclose(fits["steady-plunger"].flow_map.working_pressure(duty), working, atol=1e-3)
    # (5.10) has a parabola in place of the quartic: 43 mbar was measured, between 20 and 40 %.
    error = np.asarray(fits["polynomial"].flow_map.working_pressure(duty)) - np.asarray(working)
    assert 3e3 < np.max(np.abs(error)) < 5e3


def test_without_duty_the_chamber_is_vented(fits):
    assert fits["steady-plunger"].flow_map.working_pressure(jnp.asarray(0.0)) == pytest.approx(101013.0, abs=1e-6)


def test_facts_of_the_printed_map():
    """Erratum 25: no flow near -16 mbar, psi without roots to divide by, and duty as a fraction."""
    printed = PrintedFlow()
    phi, psi = (np.polynomial.Polynomial(np.asarray(c)) for c in (printed.phi, printed.psi))
    nearest = phi.roots()[np.argmin(np.abs(phi.roots()))]
    assert nearest.real == pytest.approx(-16.44, abs=0.01)
    assert nearest.imag == 0
    np.testing.assert_allclose(sorted(psi.roots().real)[1:], [10.5, 178.67, 599.38], atol=0.01)
    at = 60.0
    equilibrium = float(printed.equilibrium_pressure(at))
    # From that of phi, psi moves it on by 2 mbar.
    assert -16.4 < (float(printed.working_pressure(jnp.asarray(at))) - equilibrium) / 100 < -14.0
    wide_open = steady_flow(ACTUATOR, np.array(at), np.array(equilibrium + 4.3e4), RESERVOIR)
    # As a fraction, the flow is that of the saturated orifice and 41 % more; in percent it would be 60 times as much.
    assert float(printed(at, equilibrium + 4.3e4)) == pytest.approx(float(wide_open), rel=0.5)


def test_the_printed_map_inverts_where_psi_vanishes():
    printed = PrintedFlow()
    for mbar in (10.5, 178.67):
        pressure = printed.equilibrium_pressure(60.0) + 100 * mbar
        assert printed.duty_for(printed(60.0, pressure), pressure) == pytest.approx(60.0, abs=1e-9)


@pytest.mark.parametrize("flow_map", [PolynomialFlow(), PrintedFlow()], ids=["polynomial", "printed"])
def test_beyond_its_range_a_map_goes_on_along_its_tangent(flow_map):
    duty, beyond = jnp.asarray(70.0), jnp.asarray([1.3e5, 1.4e5, 1.5e5])
    assert not np.any(flow_map.valid(duty, beyond))
    flow = flow_map(duty, beyond)
    assert flow[1] - flow[0] == pytest.approx(float(flow[2] - flow[1]), rel=1e-9)  # a straight line, by rounding
    assert flow[2] < flow[0]
    assert flow_map(150.0, 6e4) == flow_map(100.0, 6e4)


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_at_another_atmosphere_a_map_is_read_at_the_same_gauge_pressure(kind, fits):
    flow_map = fits[kind].flow_map
    higher = jnp.asarray(103013.0)
    np.testing.assert_allclose(
        evaluate(flow_map, DUTY, PRESSURE + 2000, higher), evaluate(flow_map, DUTY, PRESSURE), atol=1e-15
    )
    flow = evaluate(flow_map, 50.0, 7e4)
    assert flow_map.duty_for(flow, 7.2e4, higher) == pytest.approx(50.0, abs=1e-9)
    working = flow_map.working_pressure(jnp.asarray(50.0), higher)
    assert working - flow_map.working_pressure(jnp.asarray(50.0)) == pytest.approx(2000, abs=1e-6)


@pytest.mark.parametrize("kind", OVER_DUTY)
def test_in_single_precision_a_map_is_the_same(kind, fits):
    flow_map = fits[kind].flow_map
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), flow_map)
    flow = evaluate(single, DUTY.astype(jnp.float32), PRESSURE.astype(jnp.float32))
    assert flow.dtype == jnp.float32
    # Pressures of 1e5 Pa are rounded by 4e-3 Pa, which a leak opening over 25 Pa turns into 1e-9 kg/s.
    np.testing.assert_allclose(flow, evaluate(flow_map, DUTY, PRESSURE), atol=5e-9)
    back = jax.vmap(single.duty_for)(jnp.full(3, 1e-5, jnp.float32), jnp.asarray([5e4, 6e4, 8e4], jnp.float32))
    assert back.dtype == jnp.float32
    expected = jax.vmap(flow_map.duty_for)(jnp.full(3, 1e-5), jnp.asarray([5e4, 6e4, 8e4]))
    # The same 4e-3 Pa and rounded coefficients, by some 600 Pa a percent of duty.
    np.testing.assert_allclose(back, expected, atol=1e-3)


def test_a_stiffer_membrane_gives_a_map_with_less_flow():
    stiffer = vgtjax.replace_parameters(ACTUATOR, {"converter.membrane_stiffness": 3000.0})
    duty, pressure = jnp.asarray(60.0), jnp.asarray(6.5e4)
    soft, stiff = (fit_flow_map(model).flow_map(duty, pressure) for model in (ACTUATOR, stiffer))
    assert stiff == pytest.approx(float(soft) * 2 / 3, rel=1e-9)  # lift, and so the area, goes with 1 / stiffness


def test_a_coils_map_has_the_working_pressures_of_the_coil():
    coil = vgtjax.Actuator(converter=vgtjax.Converter(magnetic_force=vgtjax.Coil()))
    duty = jnp.linspace(20.0, 90.0, 8)
    working = coil.converter.working_pressure(duty, 101013.0, RESERVOIR)
    found = fit_flow_map(coil).flow_map.working_pressure(duty)
    # Its steady pull is a polynomial of sixth degree: the quartic was measured to be 3 mbar off.
    np.testing.assert_allclose(found, working, atol=500)


BAD = [
    (
        lambda: fit_flow_map(ACTUATOR, "spline"),
        "kind must be one of steady-plunger, polynomial, .* is 'spline'; choose",
    ),
    (lambda: fit_flow_map(vgtjax.MechanicalActuator()), "fitted to the full model, .* is a MechanicalActuator; give"),
    (
        lambda: fit_flow_map(ACTUATOR, reservoir=2e5),
        "must lie between zero and the atmosphere, 101013 Pa, but it is 200",
    ),
    (
        lambda: fit_flow_map(ACTUATOR, pressure_range=(9e4, 3e4)),
        r"must rise from above zero, .* is \(90000, 30000\); give",
    ),
    (lambda: fit_flow_map(ACTUATOR, pressure_range=(3e2, 1e3)), r"overlap .* 29368 to 101013 Pa, .* is \(300, 1000"),
    (
        lambda: LiftTable(position=[0.0, 0.0]),
        "position must be at least two knots that increase, in m, .* sort them",
    ),
    (lambda: LiftTable(pressure=[1e5]), "pressure must be at least two knots that increase, in Pa, .* sort them"),
    (lambda: LiftTable(flow=[0.0]), "a table needs 4 flows, .* but it has 1; give 2 rows of 2"),
    (
        lambda: vgtjax.reduce_to_plunger_map(ACTUATOR, PolynomialFlow()),
        "needs a map over plunger position, .* a Polyno",
    ),
    (lambda: vgtjax.reduce_to_static_map(ACTUATOR, LiftTable()), "needs a map over duty, but this is a LiftTable; fit"),
]


@pytest.mark.parametrize(("call", "sentence"), BAD)
def test_bad_input_is_told_in_a_sentence(call, sentence):
    with pytest.raises(vgtjax.InputError, match=sentence):
        call()
