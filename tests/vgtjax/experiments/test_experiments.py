"""What experiments read off responses: from curves with closed forms, and from simulated actuators."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import InputError, replace_parameters, simulate
from vgtjax.experiments import (
    POSITIONS,
    SlowLoop,
    StepResponse,
    find_ends,
    find_loop,
    label,
    measure_loops,
)
from vgtjax.experiments._base import first_reach
from vgtjax.experiments._loops import LIFT

AMBIENT = 1.0e5
PRESSURES = (0.0, 1.5e5)
LOOP = SlowLoop(PRESSURES, seconds=30.0)
STEPS = StepResponse((20.0, 50.0, 80.0), hold=0.6, target=np.zeros(3))
CLOSING, OPENING = 5.0, -3.0
"""N; force of the gas at the second pressure, wherever the vanes are."""
VANES = vgtjax.HysteresisMap(closing=np.full(12, CLOSING), opening=np.full(12, OPENING))
HOT = vgtjax.Actuator(vane_force=VANES)
READ = eqx.filter_jit(lambda experiment, x_d, p_act, ambient: experiment.read(x_d, p_act, ambient))


def signals(model, experiment):
    runs = [simulate(model, trace) for trace in experiment.traces]
    return np.stack([run.x_d for run in runs]), np.stack([run.p_act for run in runs])


def readings(model, experiment):
    found = READ(experiment, *signals(model, experiment), model.air.pressure)
    return {name: np.asarray(value) for name, value in found.items()}


# The place where a signal first reaches a level.

X = jnp.asarray([0.0, 1.0, 3.0, 2.0, 4.0, 4.0])
Y = jnp.asarray([0.0, 10.0, 20.0, 30.0, 50.0, 70.0])


@pytest.mark.parametrize(
    ("level", "value"),
    # Half of the second piece; a corner; three quarters of the piece on which the level is first passed.
    [(2.0, 15.0), (3.0, 20.0), (3.5, 45.0)],
)
def test_first_reach_is_linear_between_samples(level, value):
    assert first_reach(X, Y, level) == pytest.approx(value, rel=1e-14)  # rounding


@pytest.mark.parametrize("level", [-1.0, 4.1, np.nan])
def test_what_is_passed_at_the_start_or_never_is_nan(level):
    assert np.isnan(first_reach(X, Y, level))


def test_first_reach_has_its_analytic_derivatives():
    """`y_1 + w (y_2 - y_1)` with `w = (l - x_1) / (x_2 - x_1)`: by level, both samples of x, both of y."""
    by_x, by_y, by_level = jax.jit(jax.jacfwd(first_reach, (0, 1, 2)))(X, Y, 1.5)
    slope, weight = 10.0 / 2.0, 0.25
    assert by_level == pytest.approx(slope)
    np.testing.assert_allclose(by_x, [0, -slope * (1 - weight), -slope * weight, 0, 0, 0], atol=1e-14)
    np.testing.assert_allclose(by_y, [0, 1 - weight, weight, 0, 0, 0], atol=1e-14)


@pytest.mark.parametrize("differentiate", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("call", [first_reach, jax.vmap(first_reach, (None, None, 0))])
def test_undefined_places_leave_the_derivatives_of_others_alone(differentiate, call):
    """The last two samples are equal: what is never reached lies on a piece without length."""
    levels, defined = jnp.asarray([-1.0, 1.5, 9.0, 3.5]), jnp.asarray([1.5, 3.5])
    assert np.isfinite(call(X, Y, levels)).tolist() == [False, True, False, True]
    *by_signals, by_level = jax.jit(differentiate(call, (0, 1, 2)))(X, Y, levels)
    *alone_by_signals, alone_by_level = jax.jit(differentiate(call, (0, 1, 2)))(X, Y, defined)
    for found, alone in zip(by_signals, alone_by_signals, strict=True):
        assert np.all(np.isfinite(found))
        np.testing.assert_allclose(found[1::2], alone, rtol=1e-14)
    assert np.all(np.isfinite(by_level))
    np.testing.assert_allclose(by_level[1::2, 1::2], alone_by_level, rtol=1e-14)


# Readings of curves with closed forms.


@pytest.mark.parametrize("experiment", [LOOP, STEPS, SlowLoop((0.0,)), StepResponse((7.5,), target=[1e-3])])
def test_readings_are_what_the_outputs_announce(experiment):
    time = experiment.traces[0].time
    x_d = np.zeros((len(experiment.traces), len(time)))
    found = jax.eval_shape(experiment.read, jnp.asarray(x_d), jnp.asarray(x_d), AMBIENT)
    assert sorted(found) == sorted(output.name for output in experiment.outputs)
    for output in experiment.outputs:
        assert found[output.name].shape == ((len(output.axis),) if output.axis else ())
        assert output.size == found[output.name].size


def test_straight_branches_are_read_exactly():
    """Branches `width` apart; the second pressure moves the way out by -300 Pa and the way back by 500 Pa."""
    way = 10e-3 * LOOP.traces[0].pwm / 90
    x_d = np.minimum(way, 10e-3)  # a stop at 90 % of duty, into which the pressure goes on pulling
    middle, width = -2.0e4 - 4e6 * way, 2000.0
    out = np.arange(len(x_d)) <= len(x_d) // 2
    cold, hot = np.where(out, -width / 2, width / 2), np.where(out, -width / 2 - 300, width / 2 + 500)
    found = READ(LOOP, np.stack([x_d, x_d]), AMBIENT + np.stack([middle + cold, middle + hot]), AMBIENT)
    exact = {
        "hysteresis_0mbar": width,
        "hysteresis_1500mbar": width + 800,
        "start_pressure_0mbar": -2.1e4 - 4e6 * LIFT,
        "start_pressure_1500mbar": -2.13e4 - 4e6 * LIFT,
        "end_pressure_0mbar": -2.1e4 - 4e6 * (10e-3 - LIFT),
        "saturation_shift_1500mbar": -300.0,
        "loop_width_0mbar": np.full(len(POSITIONS), width),
        "closing_pressure_0mbar": -2.1e4 - 4e6 * POSITIONS,
        "opening_pressure_1500mbar": -1.9e4 + 500 - 4e6 * POSITIONS,
        **{f"open_vane_effect_1500mbar_{place}mm": 500.0 for place in (3, 5, 7)},
        **{f"closed_vane_effect_1500mbar_{place}mm": -300.0 for place in (3, 5, 7)},
    }
    for name, value in exact.items():
        np.testing.assert_allclose(found[name], value, rtol=1e-9, err_msg=name)  # rounding of 1e5 Pa against 300


def test_a_rod_that_turns_back_before_its_stop_has_no_end_pressure():
    x_d = 9e-3 * LOOP.traces[0].pwm / 100
    p_act = AMBIENT - 2.0e4 - 4e6 * x_d
    found = READ(LOOP, np.stack([x_d, x_d]), np.stack([p_act, p_act]), AMBIENT)
    assert np.isfinite(found["start_pressure_0mbar"])
    assert np.isnan(found["end_pressure_0mbar"])
    assert np.isnan(found["saturation_shift_1500mbar"])


def test_an_exponential_step_has_its_closed_form_times():
    """To `X (1 - e^(-a t))` and back with `e^(-b t)`; held for no whole number of samples."""
    rise, fall, end = 20.0, 12.0, 6e-3
    response = StepResponse((50.0,), hold=0.6009, target=[5.5e-3])
    trace = response.traces[0]
    on, off = np.flatnonzero(np.diff(trace.pwm)) + 1
    up, down = np.maximum(trace.time - trace.time[on], 0), np.maximum(trace.time - trace.time[off], 0)
    final = end * (1 - np.exp(-rise * up[off]))
    x_d = np.where(down > 0, final * np.exp(-fall * down), end * (1 - np.exp(-rise * up)))
    found = READ(response, x_d[None], AMBIENT - 1e6 * x_d[None], AMBIENT)
    # A straight line between samples h apart is off by x'' h^2 / 8, in time by a h / 8 of h.
    chord = rise * 2e-3**2 / 8
    assert found["response_time_63_50"] == pytest.approx(-np.log(1 - 0.63 * final / end) / rise, abs=1.1 * chord)
    assert found["response_time_95_50"] == pytest.approx(-np.log(1 - 0.95 * final / end) / rise, abs=1.1 * chord)
    assert found["release_time_50"] == pytest.approx(-np.log(1 - 0.63) / fall, abs=1.1 * chord)
    assert found["steady_error_50"] == pytest.approx(final - 5.5e-3, rel=1e-9)
    (position,) = [output for output in response.outputs if output.name == "step_position_50"]
    assert position.axis[0] == pytest.approx(0.0, abs=1e-12)
    assert 0.59 < position.axis[-1] < 0.6009
    exact = end * (1 - np.exp(-rise * np.array(position.axis)))
    np.testing.assert_allclose(found["step_position_50"], exact, atol=1e-12)
    np.testing.assert_allclose(found["step_pressure_50"], -1e6 * exact, atol=1e-6)


# Slow loops of simulated actuators.


@pytest.fixture(scope="module")
def coulomb():
    """Friction and gas forces that are constant; nothing is viscous, so that balance is static."""
    model = vgtjax.Actuator(friction=vgtjax.Coulomb(viscous_damping=0.0), vane_force=VANES)
    x_d, p_act = signals(model, LOOP)
    return model, READ(LOOP, x_d, p_act, model.air.pressure), x_d


@pytest.fixture(scope="module")
def hot():
    x_d, p_act = signals(HOT, LOOP)
    return {name: np.asarray(value) for name, value in READ(LOOP, x_d, p_act, HOT.air.pressure).items()}, x_d, p_act


def test_coulomb_friction_gives_the_closed_form_width(coulomb):
    """`2 F_c / A_d`, and `(f_closing - f_opening) / A_d` more under gas."""
    model, found, _ = coulomb
    area, friction = model.diaphragm.area, model.friction.coulomb_force
    # Without damping the rod swings a little about its path after break-away: up to 12 Pa in one place, measured 0.2 in
    # the mean.
    assert found["hysteresis_0mbar"] == pytest.approx(2 * friction / area, abs=1.0)
    assert found["hysteresis_1500mbar"] == pytest.approx((2 * friction + CLOSING - OPENING) / area, abs=1.0)
    np.testing.assert_allclose(found["loop_width_0mbar"], 2 * friction / area, atol=25.0)


def test_coulomb_friction_gives_the_closed_form_branches(coulomb):
    """`-(F_0 + k x + F_c) / A_d` on the way out, the friction's sign changed on the way back."""
    model, found, x_d = coulomb
    body, friction = model.diaphragm, model.friction.coulomb_force

    def gauge(position, force):
        return -np.asarray(body.balance_force(position) + force) / body.area

    np.testing.assert_allclose(found["closing_pressure_0mbar"], gauge(POSITIONS, friction), atol=25.0)  # see above
    np.testing.assert_allclose(found["opening_pressure_0mbar"], gauge(POSITIONS, -friction), atol=25.0)
    # The preload presses the rod into the open stop, from where it lifts; acceleration is at its largest then.
    lifted = -body.preload / (body.stiffness + body.stop_stiffness) + LIFT
    assert found["start_pressure_0mbar"] == pytest.approx(gauge(lifted, friction), abs=40.0)
    turned = 0.5 * (CLOSING + OPENING) + 0.5 * (CLOSING - OPENING) * -np.expm1(-LIFT / VANES.reversal_distance)
    assert found["start_pressure_1500mbar"] == pytest.approx(gauge(lifted, friction + turned), abs=40.0)
    # The closed stop gives less under gas, by `f / (k + k_stop)`: 20 Pa.
    for name, row, force in (("0mbar", 0, 0.0), ("1500mbar", 1, CLOSING)):
        assert found[f"end_pressure_{name}"] == pytest.approx(gauge(x_d[row].max() - LIFT, friction + force), abs=2.0)


def test_gas_effects_have_the_size_and_sign_of_the_forces(coulomb):
    """A force against closing takes more vacuum on the way out; one that drives closing takes less on the way back."""
    model, found, _ = coulomb
    area = model.diaphragm.area
    for place in (3, 5, 7):
        assert found[f"closed_vane_effect_1500mbar_{place}mm"] == pytest.approx(-CLOSING / area, abs=25.0)  # see above
        assert found[f"open_vane_effect_1500mbar_{place}mm"] == pytest.approx(-OPENING / area, abs=25.0)
    assert found["saturation_shift_1500mbar"] == pytest.approx(-CLOSING / area, abs=25.0)  # stop: 20 Pa


def test_without_gauge_pressure_the_table_has_no_say(hot):
    found, *_ = hot
    other = readings(replace_parameters(HOT, {"vane_force.closing": np.full(12, 9.0)}), SlowLoop((0.0,), seconds=30.0))
    for name, value in other.items():
        np.testing.assert_array_equal(value, found[name], err_msg=name)


def test_readings_agree_with_those_of_a_loop_of_a_trace(hot):
    found, x_d, p_act = hot
    gauge = p_act - float(HOT.air.pressure)
    for row, at in enumerate(("0mbar", "1500mbar")):
        loop = find_loop(LOOP.traces[row].time, x_d[row], gauge[row])
        # A broken line with corners every 0.5 mm: what the branches bend in between, measured 0.4 Pa.
        np.testing.assert_allclose(loop.closing, found[f"closing_pressure_{at}"], atol=1.0)
        np.testing.assert_allclose(loop.opening, found[f"opening_pressure_{at}"], atol=1.0)
        assert loop.mean_width == pytest.approx(found[f"hysteresis_{at}"], abs=0.1)
        # One straight line through 0.2 mm, in which friction and gas build up: measured 63 Pa.
        start, end = find_ends(x_d[row], gauge[row])
        assert start == pytest.approx(found[f"start_pressure_{at}"], abs=80.0)
        assert end == pytest.approx(found[f"end_pressure_{at}"], abs=10.0)


def test_noisy_traces_give_the_readings_of_the_simulation(hot):
    """Sensors that are 30 or 70 um and 300 or -200 Pa off and noisy, gas 15 mbar beside its operating point."""
    found, x_d, p_act = hot
    rng = np.random.default_rng(5)
    traces = [
        trace.replace(
            x_d=x_d[row] + (30e-6, 70e-6)[row] + 8e-6 * rng.normal(size=x_d[row].shape),
            p_act=p_act[row] + (300.0, -200.0)[row] + 60.0 * rng.normal(size=x_d[row].shape),
            p_trb=trace.p_trb + 1500.0,
        )
        for row, trace in enumerate(LOOP.traces)
    ]
    measured = measure_loops(traces[::-1])
    assert measured.turbine_pressures == PRESSURES
    assert sorted(measured.readings) == sorted(found)
    assert measured.hysteresis == {at: measured.readings[f"hysteresis_{label(at)}"] for at in PRESSURES}
    # What offsets are left: the positions' mean, which moves all branches along their slope, by 205 Pa.
    moved = HOT.diaphragm.stiffness / HOT.diaphragm.area * 50e-6

    def error(name, offset=0.0):
        return np.abs(measured.readings[name] - offset - found[name]).max()

    # Four standard deviations over 200 draws of the noise, each: 5 Pa in the mean width and 27 in one place, 22 of
    # branches, 31 of effects, 33 and 21 of the ends.
    for at in ("0mbar", "1500mbar"):
        assert error(f"hysteresis_{at}") < 20.0
        assert error(f"loop_width_{at}") < 110.0
        assert error(f"closing_pressure_{at}", moved) < 90.0
        assert error(f"opening_pressure_{at}", moved) < 90.0
        assert error(f"start_pressure_{at}") < 135.0 + 63.0  # what the straight line is off besides
        assert error(f"end_pressure_{at}") < 85.0 + 30.0  # the highest of noisy samples lies too high
    for place in (3, 5, 7):
        assert error(f"open_vane_effect_1500mbar_{place}mm") < 125.0
        assert error(f"closed_vane_effect_1500mbar_{place}mm") < 125.0
    assert error("saturation_shift_1500mbar") < 125.0


@pytest.mark.parametrize(
    ("change", "name", "direction"),
    [
        ({"friction.static_force": 4.8, "friction.coulomb_force": 4.2}, "hysteresis_0mbar", 1),
        ({"friction.viscous_damping": 400.0}, "hysteresis_0mbar", 1),
        ({"diaphragm.area": 3.2e-3}, "hysteresis_0mbar", -1),
        ({"diaphragm.stiffness": 1.3e4}, "end_pressure_0mbar", -1),
        ({"diaphragm.preload": 55.0}, "start_pressure_0mbar", -1),
        ({"vane_force.opening": np.full(12, -6.0)}, "hysteresis_1500mbar", 1),
        ({"vane_force.closing": np.full(12, 8.0)}, "saturation_shift_1500mbar", -1),
    ],
)
def test_loops_change_in_the_physical_direction(change, name, direction, hot):
    other = readings(replace_parameters(HOT, change), LOOP)
    assert direction * (other[name] - hot[0][name]) > 50.0  # Pa; every one of these moves 0.5 mbar at least


# Step responses of simulated actuators.


@pytest.fixture(scope="module")
def steps():
    response = StepResponse.around(HOT, STEPS.duties, STEPS.hold)
    return response, readings(HOT, response)


def test_times_are_in_order_and_the_nominal_actuator_has_no_error(steps):
    _, found = steps
    for duty in (50, 80):
        assert 0 < found[f"response_time_63_{duty}"] < found[f"response_time_95_{duty}"] < STEPS.hold
        assert 0 < found[f"release_time_{duty}"] < 1.5
        assert found[f"steady_error_{duty}"] == 0.0
    assert found["step_position_80"][-1] > found["step_position_50"][-1] > 3e-3
    assert found["step_pressure_80"][-1] < found["step_pressure_50"][-1] < 0


def test_a_rod_that_does_not_move_has_no_times(steps):
    """At 20 % the chamber reaches 69 mbar; the preload takes 169."""
    _, found = steps
    assert found["step_pressure_20"][-1] < -5000.0
    for name in ("response_time_63_20", "response_time_95_20", "release_time_20"):
        assert np.isnan(found[name])
    assert np.isfinite(found["steady_error_20"])


@pytest.mark.parametrize(
    ("change", "name", "direction"),
    [
        ({"diaphragm.stiffness": 1.3e4}, "steady_error_50", -1),
        ({"diaphragm.preload": 45.0}, "steady_error_50", 1),
        ({"chamber.volume": 1.2e-4}, "response_time_63_80", 1),
        ({"friction.viscous_damping": 400.0}, "release_time_80", 1),
        ({"converter.reservoir_orifice_slope": 5e-4}, "response_time_63_80", -1),
    ],
)
def test_steps_change_in_the_physical_direction(change, name, direction, steps):
    response, found = steps
    other = readings(replace_parameters(HOT, change), response)
    least = 1e-4 if name.startswith("steady") else 2e-3  # m, s
    assert direction * (other[name] - found[name]) > least


# What can't be done is refused.


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: SlowLoop(()), r"pressures must be one or more and rise by millibars, but they are \[\] Pa; sort them"),
        (lambda: SlowLoop((1e5, 0.0)), r"but they are \[100000.0, 0.0\] Pa; sort them"),
        (lambda: SlowLoop((0.0, 0.0)), r"but they are \[0.0, 0.0\] Pa; sort them"),
        (lambda: SlowLoop(seconds=1.0), r"a slow loop needs 2 s to an hour .* they are 1 s and 100 %; correct them"),
        (lambda: SlowLoop(duty=0.0), r"a duty above 0 up to 100 %, but they are 30 s and 0 %"),
        (lambda: SlowLoop(duty=101.0), r"but they are 30 s and 101 %"),
        (lambda: StepResponse((), target=[]), r"one or more different duties above 0 up to 100 %, but they are \[\]"),
        (lambda: StepResponse((50.0, 120.0), target=[0, 0]), r"but they are \[50.0, 120.0\]; correct them"),
        (lambda: StepResponse((50.0, 50.0), target=[0, 0]), r"but they are \[50.0, 50.0\]; correct them"),
        (lambda: StepResponse(hold=0.4, target=[0, 0]), "held for 0.5 s to an hour, but hold is 0.4 s; correct it"),
        (lambda: StepResponse.around(HOT, ()), r"one or more different duties above 0 up to 100 %, but they are \[\]"),
        (lambda: StepResponse(target=[0]), "one target a duty, but there are 1 for 2; give both"),
    ],
)
def test_an_experiment_that_can_not_be_is_refused(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_names_count_in_millibar():
    assert [label(pressure) for pressure in (0.0, 1.5e5, 2.994e5)] == ["0mbar", "1500mbar", "2994mbar"]
