"""The design model, and the observer of pressure and friction on it."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import DesignModel, DesignState, ObservedState, PressureObserver
from vgtjax.reduced import PrintedFlow, StaticMapActuator

RATES = {"friction_rate": 15.0, "pressure_rate": 20.0}
SLIDING = PressureObserver(**RATES, injection_rate=0.0, switching_gain=60.0)
SMOOTH = PressureObserver(**RATES, injection_rate=5000.0)
AMBIENT = jnp.asarray(101_013.0)
MIDDLE = 0.004
"""m; where the rod starts."""
STEP = 2e-5
"""s"""
WRONG = (20e-6, 800.0)
"""m and Pa; errors of the observer at the start."""


def number(value):
    return jnp.asarray(value, dtype=float)


@pytest.mark.parametrize("exponent", [1, 2])
def test_the_design_model_is_the_reduced_actuator_away_from_its_stops(exponent):
    plant = StaticMapActuator(friction=vgtjax.LuGre(stribeck_exponent=exponent))
    trace = vgtjax.Trace(np.arange(2) * 1e-3, pwm=np.full(2, 55.0))
    drive = jax.tree.map(lambda leaf: jnp.asarray(leaf)[0], trace.drive())
    start = plant.start(trace.start(), drive)
    model = DesignModel.of(plant, plant.flow_map)
    for velocity, deflection in ((0.004, 3e-5), (-0.02, 5e-5), (0.0, -2e-5)):
        body = dataclasses.replace(start.rod.body, position=number(0.003), velocity=number(velocity))
        bristle = dataclasses.replace(start.rod.friction, deflection=number(deflection))
        rod = dataclasses.replace(start.rod, body=body, friction=bristle)
        rates = plant.vector_field(number(0.0), dataclasses.replace(start, rod=rod, pressure=number(6e4)), drive)
        at = DesignState(number(0.003), number(velocity), number(deflection), number(6e4))
        found = model.rates(at, number(55.0), AMBIENT)
        expected = (rates.rod.body.position, rates.rod.body.velocity, rates.rod.friction.deflection, rates.pressure)
        # The same equations in another order: rounding alone.
        np.testing.assert_allclose(jax.tree.leaves(found), jax.tree.leaves(expected), rtol=1e-11)
        flow = model.flow_for(found.pressure, at.position, at.velocity, at.pressure)
        assert float(flow) == pytest.approx(float(plant.flow_map(number(55.0), at.pressure)), rel=1e-11)


@pytest.mark.parametrize("exponent", [1, 2])
@pytest.mark.parametrize("velocity", [-0.03, -0.0008, 0.0002, 0.007])
def test_slopes_are_those_of_automatic_differentiation(exponent, velocity):
    model, at = DesignModel(friction=vgtjax.LuGre(stribeck_exponent=exponent)), number(velocity)
    assert float(model.alpha_slope(at)) == pytest.approx(float(jax.grad(model.alpha)(at)), rel=1e-12)
    assert float(model.stiffness_slope(at)) == pytest.approx(float(jax.grad(model.stiffness)(at)), rel=1e-12)


def test_the_stiffness_of_the_bristles_changes_its_sign_at_sliding_velocities():
    # g / sigma_1 with g = F_c that far above the Stribeck velocity.
    model, edge = DesignModel(), 2.8 / 429.77
    assert float(model.stiffness(number(0.99 * edge))) > 0 > float(model.stiffness(number(1.01 * edge)))


def shift(state, rates, by):
    return jax.tree.map(lambda value, rate: value + by * rate, state, rates)


def advance(model, state, duty, step):
    """The classical Runge-Kutta method."""

    def rates(at):
        return model.rates(at, duty, AMBIENT)

    first = rates(state)
    second = rates(shift(state, first, step / 2))
    third = rates(shift(state, second, step / 2))
    last = rates(shift(state, third, step))
    mean = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, first, second, third, last)
    return shift(state, mean, step)


@eqx.filter_jit
def observe(observer, model, seconds=0.4, step=STEP):
    """Errors at every sample of bristles in m and pressure in Pa, true velocity in m/s, and observed states.

    The design model is driven by an open-loop duty; position and velocity are told without error, the observer starts
    `WRONG`.
    """

    def sample(carry, time):
        state, seen = carry
        duty = 60.0 - 25.0 * jnp.sin(20.0 * time)
        state = advance(model, state, duty, step)
        seen, rate = observer.step(seen, state.position, state.velocity, duty, AMBIENT, step)
        errors = state.deflection - seen.deflection, state.pressure - seen.pressure
        return (state, seen), (*errors, state.velocity, seen, rate)

    body, velocity, deflection = model.diaphragm, number(0.008), number(3e-5)
    force = body.preload + body.stiffness * MIDDLE + model.friction_force(velocity, deflection)
    state = DesignState(number(MIDDLE), velocity, deflection, AMBIENT - force / body.area)
    seen = ObservedState(velocity, deflection - WRONG[0], state.pressure - WRONG[1])
    return jax.lax.scan(sample, (state, seen), step * jnp.arange(round(seconds / step)))[1]


@pytest.mark.parametrize("observer", [SLIDING, SMOOTH], ids=["sliding", "smooth"])
def test_the_errors_fall_in_every_sample(observer):
    deflection, pressure, velocity, _, _ = observe(observer, observer.model)
    # Friction reverses, and S(v) takes both signs.
    assert np.min(velocity) < -0.0066
    assert np.max(velocity) > 0.0066
    value = np.asarray(observer.lyapunov(deflection, pressure))
    # The error of implicit Euler is left: at this step 6e-7 of the first value, and in proportion to the step.
    falling = np.argmax(value < 2e-6 * value[0])
    assert falling > 0
    assert np.all(np.diff(value[:falling]) < 0)
    assert np.max(value[falling:]) < 3e-6 * value[0]
    # Measured: 55 1/s sliding, 50 1/s smooth.
    tenth = round(0.1 / STEP)
    assert value[tenth] < value[0] * np.exp(-45 * 0.1)


def test_a_pressure_gain_as_printed_diverges():
    """`K6 > 0`, which no observer can be built with."""
    printed = eqx.tree_at(lambda o: o.pressure_rate, SLIDING, number(-20.0))
    _, pressure, _, _, _ = observe(printed, printed.model)
    assert abs(float(pressure[-1])) > 10 * WRONG[1]


def test_a_large_friction_gain_makes_errors_grow():
    """ "Sufficiently large" after [5.20]."""
    large = eqx.tree_at(lambda o: o.friction_rate, SLIDING, number(2000.0))
    deflection, pressure, _, _, _ = observe(large, large.model)
    value = np.asarray(large.lyapunov(deflection, pressure))
    assert np.max(value) > 3 * value[0]


def test_the_observed_rate_is_that_of_the_observed_bristles():
    _, _, _, seen, rate = observe(SMOOTH, SMOOTH.model)
    # Implicit Euler: exact, up to rounding of 1e-5 m over 2e-5 s.
    np.testing.assert_allclose(np.diff(seen.deflection) / STEP, rate[1:], atol=1e-13)


def test_a_sliding_observer_holds_its_velocity_whatever_the_period():
    """The explicit sign chatters by `K2` times the period, 0.06 m/s here."""
    _, _, velocity, seen, _ = observe(SLIDING, SLIDING.model, step=1e-3)
    np.testing.assert_allclose(seen.velocity[20:], velocity[20:], atol=1e-12)


def test_what_the_observer_is_told_may_be_sampled_at_a_kilohertz():
    deflection, pressure, _, _, _ = observe(SMOOTH, SMOOTH.model, seconds=1.0, step=1e-3)
    # One step of implicit Euler lags by a period: 1 ms of 1e5 Pa/s at most.
    assert np.max(np.abs(pressure[500:])) < 100.0
    assert np.max(np.abs(deflection[500:])) < 1e-5


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"friction_rate": 0.0}, r"friction_rate must be positive, but it is 0\.0; use e\.g\. 5"),
        ({"pressure_rate": -20.0}, r"pressure_rate must be positive, but it is -20\.0"),
        ({"switching_gain": -1.0}, "switching_gain must not be negative, but it is -1.0; use zero for none"),
        ({"injection_rate": 0.0}, "injection_rate plus switching_gain must be positive, .* but it is 0.0"),
        (
            {"friction_rate": 27.0},
            r"friction_rate must be at most 4 sigma_0 F_c .* = 26\.16 1/s, but it is 27\.0; lower",
        ),
        (
            {"friction_rate": 15.0, "largest_velocity": 0.2},
            r"friction_rate must be at most .* = 13\.08 1/s, but it is 15\.0",
        ),
    ],
)
def test_gains_that_break_a_condition_are_refused(settings, sentence):
    with pytest.raises(vgtjax.InputError, match=sentence):
        PressureObserver(**settings)


def test_a_map_whose_flow_hardly_falls_with_pressure_needs_a_faster_correction():
    model = DesignModel(PrintedFlow())
    PressureObserver(model)
    with pytest.raises(
        vgtjax.InputError, match=r"pressure_rate b must outweigh .* up to 2\.96 1/s, but it is 2\.5; raise"
    ):
        PressureObserver(model, pressure_rate=2.5)
    rising = eqx.tree_at(lambda m: m.flow_map.pressure, DesignModel(), jnp.asarray([5e-4, 1e-9, 0.0]))
    with pytest.raises(vgtjax.InputError, match="pressure_rate b must outweigh the growth F"):
        PressureObserver(rising)


def test_the_margin_is_that_of_the_quadratic_form():
    """Against the eigenvalues of the form, from the error dynamics at a constant velocity."""
    margin, growth = PressureObserver(**RATES).stability_margin()
    model, a, b = DesignModel(), 15.0, 20.0
    for index, speed in enumerate(np.linspace(0.0, 0.1, 101)):
        y = 429.77 * float(model.forgetting(number(speed))) / 43135.0
        form = np.array([[43135.0 / 429.77 * y + a * (1 - y), a], [b * (1 - y), b - float(growth[index])]])
        weighted = np.diag([1.0, a / b]) @ form
        eigenvalues = np.linalg.eigvalsh(weighted + weighted.T)
        assert (eigenvalues[0] > 0) == (float(margin[index]) > 0)
        assert float(margin[index]) <= np.prod(eigenvalues) / 4 * b / a * (1 + 1e-9)
