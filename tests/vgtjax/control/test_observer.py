"""The design model, and the observer of pressure and friction on it."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import StaticMapActuator
from vgtjax.control import DesignModel, DesignState, Motion, ObservedState, PressureObserver
from vgtjax.parts import Flow, PrintedFlow

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
    model = DesignModel.for_plant(plant, plant.flow_map)
    for velocity, deflection in ((0.004, 3e-5), (-0.02, 5e-5), (0.0, -2e-5)):
        body = dataclasses.replace(start.rod.body, position=number(0.003), velocity=number(velocity))
        bristle = dataclasses.replace(start.rod.friction, deflection=number(deflection))
        rod = dataclasses.replace(start.rod, body=body, friction=bristle)
        rates = plant.vector_field(number(0.0), dataclasses.replace(start, rod=rod, air_path=number(6e4)), drive)
        at = DesignState(number(0.003), number(velocity), number(deflection), number(6e4))
        found = model.rates(at, number(55.0), AMBIENT)
        expected = (rates.rod.body.position, rates.rod.body.velocity, rates.rod.friction.deflection, rates.air_path)
        # The same equations in another order: rounding alone.
        np.testing.assert_allclose(jax.tree.leaves(found), jax.tree.leaves(expected), rtol=1e-11)
        flow = model.flow_for(found.pressure, at.position, at.velocity, at.pressure)
        assert float(flow) == pytest.approx(float(plant.flow_map(number(55.0), at.pressure)), rel=1e-11)


def test_with_the_ratio_of_heat_capacities_the_chamber_is_adiabatic_at_the_temperature_of_the_air():
    plant = vgtjax.Actuator()
    model = DesignModel(exponent=plant.air.heat_capacity_ratio)
    position, velocity, pressure, flow = map(number, (0.003, -0.02, 6e4, 2e-5))
    entering = Flow(flow, plant.air.temperature)
    swept = plant.diaphragm.displaced_volume(position), plant.diaphragm.displaced_volume(velocity)
    rates = plant.chamber.rates(plant.air, vgtjax.parts.GasState(pressure, plant.air.temperature), entering, *swept)
    found = model.pressure_rate(flow, position, velocity, pressure)
    # The same equation in another order: rounding alone.
    assert float(found) == pytest.approx(float(rates.pressure), rel=1e-12)
    assert float(model.flow_for(found, position, velocity, pressure)) == pytest.approx(float(flow), rel=1e-11)


@pytest.mark.parametrize("exponent", [1, 2])
@pytest.mark.parametrize("velocity", [-0.03, -0.0008, 0.0002, 0.007])
def test_slopes_are_those_of_automatic_differentiation(exponent, velocity):
    model, at = DesignModel(friction=vgtjax.LuGre(stribeck_exponent=exponent)), number(velocity)
    assert float(model.alpha_slope(at)) == pytest.approx(float(jax.grad(model.alpha)(at)), rel=1e-12)
    assert float(model.stiffness_slope(at)) == pytest.approx(float(jax.grad(model.stiffness)(at)), rel=1e-12)


def test_a_slide_whose_sign_has_a_width_has_its_derivative_at_rest_too():
    """Where an estimated velocity is exactly zero: `1 / (width g)`, as next to it."""
    model, width = DesignModel(), 1e-3
    slope = jax.grad(lambda velocity: model.slide_slope(velocity, width))
    at_rest, beside = float(slope(number(0.0))), float(slope(number(1e-12)))
    assert at_rest == pytest.approx(1 / (width * float(model.friction.static_force)), rel=1e-12)
    # The kink of |v|, of which a derivative takes the mean at zero: the Stribeck curve's part is one of both sides.
    assert beside == pytest.approx(at_rest + float(model.alpha_slope(number(1e-12))), rel=1e-6)
    assert np.isfinite(float(jax.grad(model.slide_slope)(number(0.0))))


def test_the_stiffness_of_the_bristles_changes_its_sign_at_sliding_velocities():
    # g / sigma_1 with g = F_c that far above the Stribeck velocity.
    model, edge = DesignModel(), 2.8 / 429.77
    assert float(model.stiffness(number(0.99 * edge))) > 0 > float(model.stiffness(number(1.01 * edge)))


def test_a_share_of_the_force_balance_holds_near_the_stops():
    model, margin, travel = DesignModel(), 2e-5, 10.13e-3
    places = {
        -1e-4: 0.0,
        0.0: 0.0,
        0.25 * margin: 0.25,
        margin: 1.0,
        MIDDLE: 1.0,
        travel - margin / 2: 0.5,
        travel: 0.0,
    }
    for position, share in places.items():
        # Rounding of the travel over the margin.
        assert float(model.off_stops(number(position))) == pytest.approx(share, abs=1e-12)
    endless = DesignModel(diaphragm=vgtjax.Diaphragm(travel=np.inf))
    assert float(endless.off_stops(number(0.0))) == 1.0
    # A stop takes up what drives the rod into it and nothing else.
    for position, acceleration, held in ((0.0, -2.0, 0.0), (0.0, 2.0, 2.0), (travel, 2.0, 0.0), (MIDDLE, -2.0, -2.0)):
        assert float(model.stopped(number(position), number(acceleration))) == pytest.approx(held, abs=1e-12)


@eqx.filter_jit
def rest(observer, pressure):
    """Largest error of the pressure in Pa and friction in N after a second on the open stop, under a duty that keeps a
    pressure in Pa absolute."""
    motion = Motion(number(0.0), number(0.0), AMBIENT)
    duty = observer.model.flow_map.duty_for(number(0.0), pressure, AMBIENT)

    def sample(seen, _):
        seen, _ = observer.step(seen, motion, duty, 1e-3)
        return seen, pressure - seen.pressure

    seen, errors = jax.lax.scan(sample, observer.initial_state(pressure), length=1000)
    return jnp.max(jnp.abs(errors)), observer.model.friction_force(motion.velocity, seen.deflection)


@pytest.mark.parametrize("observer", [SLIDING, SMOOTH], ids=["sliding", "smooth"])
def test_what_a_stop_carries_is_not_taken_for_pressure_or_friction(observer):
    # 3 kPa above what lifts the rod off the open stop, which carries 8.8 N.
    pressure = number(float(AMBIENT) - 49.46 / 2.9224e-3 + 3e3)
    error, friction = rest(observer, pressure)
    # The flow map alone, which is exact here, but for the rounding of its inverse.
    assert float(error) < 1e-6
    assert float(friction) == 0.0
    # Without stops, pressure takes the larger part at first, and friction in the end.
    error, friction = rest(eqx.tree_at(lambda o: o.model.diaphragm.travel, observer, number(np.inf)), pressure)
    assert float(error) > 1000.0
    assert abs(float(friction)) > 8.0


VANES = vgtjax.HysteresisMap(closing=np.linspace(2.5, 1.2, 12), opening=np.linspace(-1.8, -0.9, 12))
"""N; falling from the closed end to the open one."""


@pytest.mark.parametrize("vane_force", [VANES, vgtjax.ForcePolynomial()], ids=["map", "polynomial"])
def test_the_rate_of_the_load_is_that_of_the_load_along_the_motion(vane_force):
    model, velocity, step = DesignModel(vane_force=vane_force), 0.004, 1e-4
    state = jax.tree.map(lambda _: number(0.4), vane_force.initial_state())

    def at(time):
        return Motion(number(MIDDLE + velocity * time), number(velocity), AMBIENT, number(2e5))

    def load(time):
        return model.vane_load(at(time), jax.tree.map(lambda s, r: s + time * r, state, rate))[0]

    rate = model.vane_load(at(0.0), state)[1]
    ahead, behind = load(step), load(-step)
    # Central differences: the load bends by the square of 6 s/s times the step.
    assert float(model.vane_load_rate(at(0.0), state)) == pytest.approx(float(ahead - behind) / (2 * step), rel=1e-6)
    assert abs(float(model.vane_load_rate(at(0.0), state))) > 0.1


def test_the_state_of_the_vanes_follows_the_direction_however_fast_the_rod_is():
    model, state = DesignModel(vane_force=VANES), VANES.initial_state()
    for velocity, way in ((0.01, 1.0), (-0.2, -1.0), (0.0, -1.0)):
        motion = Motion(number(MIDDLE), number(velocity), AMBIENT, number(2e5))
        for _ in range(50):
            state = model.vane_state_after(motion, state, 1e-3)
        # 0.5 mm are eight of the map's reversal distances; where the rod rests, nothing relaxes.
        assert float(state.sign) == pytest.approx(way, abs=2e-3)


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

    The design model is driven by an open-loop duty; position and velocity are known without error, the observer starts
    `WRONG`.
    """

    def sample(carry, time):
        state, seen = carry
        duty = 60.0 - 25.0 * jnp.sin(20.0 * time)
        state = advance(model, state, duty, step)
        seen, rate = observer.step(seen, Motion(state.position, state.velocity, AMBIENT), duty, step)
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


@pytest.mark.parametrize("observer", [SLIDING, SMOOTH], ids=["sliding", "smooth"])
def test_the_errors_fall_in_every_sample_with_a_share_of_the_correction_too(observer):
    """A margin of 8 mm makes a share of some 0.4 of the middle, and another at every position."""
    partly = eqx.tree_at(lambda o: o.model.stop_margin, observer, number(8e-3))
    assert 0.2 < float(partly.model.off_stops(number(MIDDLE))) < 0.6
    deflection, pressure, _, _, _ = observe(partly, observer.model)
    value = np.asarray(observer.lyapunov(deflection, pressure))
    falling = np.argmax(value < 2e-6 * value[0])
    assert np.all(np.diff(value[: falling or None]) < 0)
    assert value[-1] < 0.01 * value[0]


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


def test_what_the_observer_measures_may_be_sampled_at_a_kilohertz():
    deflection, pressure, _, _, _ = observe(SMOOTH, SMOOTH.model, seconds=1.0, step=1e-3)
    # One step of implicit Euler lags by a period: 1 ms of 1e5 Pa/s at most.
    assert np.max(np.abs(pressure[500:])) < 100.0
    assert np.max(np.abs(deflection[500:])) < 1e-5


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"friction_rate": 0.0}, r"friction_rate must be positive, but it is 0\.0; raise it"),
        ({"pressure_rate": 0.0}, r"pressure_rate must be positive, but it is 0\.0"),
        ({"switching_gain": -1.0}, r"switching_gain' must be finite and not negative, but it is -1; correct it"),
        (
            {"switching_gain": 1.24, "largest_pressure_error": 6e3},
            r"switching_gain must exceed .* = 27\.83 m/s2 at the largest errors .* but it is 1\.24; raise it",
        ),
        (
            # S at 0.1 m/s is -619 kN/m, of which 1 um is 0.98 m/s2.
            {"switching_gain": 0.9, "largest_deflection_error": 1e-6},
            r"switching_gain must exceed .* = 0\.98\d* m/s2",
        ),
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
        y = 429.77 * float(model.relaxation_rate(number(speed))) / 43135.0
        form = np.array([[43135.0 / 429.77 * y + a * (1 - y), a], [b * (1 - y), b - float(growth[index])]])
        weighted = np.diag([1.0, a / b]) @ form
        eigenvalues = np.linalg.eigvalsh(weighted + weighted.T)
        assert (eigenvalues[0] > 0) == (float(margin[index]) > 0)
        assert float(margin[index]) <= np.prod(eigenvalues) / 4 * b / a * (1 + 1e-9)
