"""What tuning is made of: objective, cases, gains, conditions of the designs, smoothing, and derivatives that fade."""

import dataclasses
import math
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import (
    PI,
    PID,
    AdaptiveBackstepping,
    Constant,
    FrictionCompensation,
    Knocker,
    PressureObserver,
    Sine,
)
from vgtjax.control.loop._loop import fade
from vgtjax.parts._converter import GENTLE_OPENING
from vgtjax.tuning import (
    Linearisation,
    Objective,
    TuningProblem,
    Variant,
    conditions,
    cross_cases,
    gain_names,
    plan_tuning,
    soften,
    soften_cases,
)
from vgtjax.tuning._objective import SHARPNESS, mean_beyond

REFERENCES = {"sine": Sine(0.003, 15.0, 0.005), "hold": Constant(0.004)}
OBJECTIVE = Objective(tracking=1e-4, effort=200.0, chatter=1.0, largest_error=2e-4)


@pytest.mark.parametrize(("share", "expected"), [(0.0, 2.5), (1.0, 4.0)])
def test_mean_and_worst_case_are_the_ends_of_the_combination(share, expected):
    costs = jnp.asarray([1.0, 2.0, 3.0, 4.0])
    # A power of 200 leaves 4 (1/4)^(1/200), 0.7 % less.
    assert float(Objective(worst=share, power=200.0).combine(costs)) == pytest.approx(expected, rel=1e-2)


def test_the_combination_of_large_costs_does_not_overflow():
    assert float(Objective().combine(jnp.asarray([1e60, 1.0]))) == pytest.approx(1e60 * (0.25 + 0.5 * 0.5**0.125))


@pytest.mark.parametrize("quantile", [0.5, 0.8, 0.9])
def test_the_mean_beyond_a_quantile_is_that_of_the_sorted_costs(quantile):
    costs = np.random.default_rng(0).permutation(np.geomspace(1.0, 100.0, 20))
    beyond = np.sort(costs)[round(20 * quantile) :].mean()
    found = float(mean_beyond(jnp.asarray(costs), quantile))
    # It is above the sharp one, by the bound of its docstring at most.
    assert beyond <= found <= beyond + SHARPNESS * costs.mean() * math.log(2) / (1 - quantile)
    objective = Objective(worst=0.25, quantile=quantile)
    assert float(objective.combine(jnp.asarray(costs))) == pytest.approx(0.75 * costs.mean() + 0.25 * found)
    first, second = objective.derivatives(costs)
    assert np.all(first > 0)
    # Convex: no eigenvalue is negative but for the rounding of slopes of the order of one.
    assert np.linalg.eigvalsh(second)[0] >= -1e-15


@pytest.mark.parametrize(("worst", "quantile"), [(0.5, 1.0), (1.0, 0.4)])
def test_derivatives_of_the_combination(worst, quantile):
    costs, objective = np.array([1.0, 1.05, 1.1]), Objective(worst=worst, quantile=quantile)
    first, second = objective.derivatives(costs)
    step = 1e-5 * np.eye(3)
    slopes = [float(objective.combine(costs + d) - objective.combine(costs - d)) / 2e-5 for d in step]
    # Central differences: 1e-10 of the third derivative, 2500 where a cost counts over 0.02; 1e-11 of rounding.
    np.testing.assert_allclose(first, slopes, rtol=1e-6)
    bends = [(objective.derivatives(costs + d)[0] - objective.derivatives(costs - d)[0]) / 2e-5 for d in step]
    np.testing.assert_allclose(second, bends, rtol=1e-6, atol=1e-8)
    assert np.linalg.eigvalsh(second)[0] > -1e-12, "convex, or the model of a step has no minimum"


def _compensation(gain):
    return FrictionCompensation(derivative_gain=gain)


BOUNDS = {
    "friction-compensation": (_compensation, "derivative_gain above its bound [5.9]", 60.0, 70.0),
    "knocker": (lambda w: Knocker(PI(), width=w), "width below interval [5.5]", 0.041, 0.039),
    "observer": (lambda a: PressureObserver(friction_rate=a), "friction_rate below its bound [5.21]", 30.0, 3.0),
    "sliding": (
        lambda k: PressureObserver(switching_gain=k, largest_pressure_error=6e3),
        "switching_gain above its bound [5.16]",
        1.24,  # where tuning ended while no error was stated
        30.0,
    ),
    "adaptive": (
        lambda w: AdaptiveBackstepping(pressure_weight=w, pressure_coupling=0.0),
        "pressure_weight above its bound [5.71]",
        1e-12,
        1e-6,
    ),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_conditions_are_those_that_a_design_checks_when_it_is_built(name):
    build, condition, outside, inside = BOUNDS[name]
    kept = conditions(build(inside))
    assert float(kept[condition]) > 0
    with pytest.raises(vgtjax.InputError):
        build(outside)
    # What can't be built by its constructor can be looked at all the same.
    leaf = {
        "friction-compensation": "derivative_gain",
        "knocker": "width",
        "observer": "friction_rate",
        "sliding": "switching_gain",
        "adaptive": "pressure_weight",
    }
    broken = vgtjax.replace_parameters(build(inside), {leaf[name]: outside})
    assert float(conditions(broken)[condition]) < 0


def test_gains_are_what_a_controller_does_and_not_what_it_believes():
    assert gain_names(PI(base=control.StaticBalance())) == ["proportional_gain", "integral_gain", "tracking_time"]
    assert "observer.friction_rate" in gain_names(control.Backstepping())
    assert not [name for name in gain_names(control.Backstepping()) if "model" in name or "load" in name]
    own = [name for name in gain_names(FrictionCompensation()) if not name.startswith("differentiator.")]
    assert own == ["proportional_gain", "derivative_gain", "observer_gain"]


def test_softening_widens_what_switches_and_nothing_else(actuator):
    sharp = Knocker(PID(PI(), differentiator=control.LevantDifferentiator(0.5)))
    soft = soften(sharp)
    assert float(soft.sign_width) == 0.2
    assert float(soft.controller.differentiator.width) == 3e-5
    assert soften(soft) == soft, "twice is once"
    wide = Knocker(PI(), sign_width=5.0)
    assert float(soften(wide).sign_width) == 5.0, "nothing is made sharper"
    plant = soften(actuator)
    assert plant.converter.opening_width == GENTLE_OPENING
    assert eqx.tree_equal(dataclasses.replace(plant.converter, opening_width=1e-6), actuator.converter)


def test_smoothed_cases_have_sensors_without_steps(actuator):
    sensors = control.Sensors(control.Sensor(8e-6, quantum=1e-6), control.Sensor(60.0, quantum=3.0), control.Sensor())
    soft = soften_cases(cross_cases({"a": actuator}, REFERENCES, duration=0.1, sensors=sensors)).scenarios.sensors
    assert not np.any(soft.position.quantum)
    assert not np.any(soft.pressure.quantum)
    np.testing.assert_array_equal(soft.position.noise, [8e-6, 8e-6])


def test_cases_cross_everything_and_begin_where_the_reference_does(actuator):
    references = {**REFERENCES, "rise": control.signal_2()}
    cases = cross_cases({"a": actuator, "b": actuator}, references, [0.0, 3e5], duration=0.1)
    assert len(cases) == 12
    assert str(cases.labels[3]) == "a, hold, 3000 mbar"
    begins = np.asarray(cases.scenarios.start.position)
    np.testing.assert_allclose(begins[:6], [0.005, 0.005, 0.004, 0.004, 0.0, 0.0])
    np.testing.assert_array_equal(np.asarray(cases.scenarios.start.at_rest)[:6], [0, 0, 0, 0, 1, 1])
    assert len({tuple(row) for row in np.asarray(jax.random.key_data(cases.scenarios.key))}) == 12
    assert [str(label) for label in cases.take([3, 0]).labels] == ["a, hold, 3000 mbar", "a, sine, 0 mbar"]


def test_variants_are_crossed_with_all_else(actuator):
    noisy = control.Sensors(control.Sensor(2e-5), control.Sensor(), control.Sensor())
    late = {
        name: Variant(sensors, (control.LateDuty(delay),))
        for name, sensors, delay in (("", control.Sensors.bench(), 0.0), ("late", noisy, 0.004))
    }
    cases = cross_cases({"a": actuator}, REFERENCES, duration=0.1, variants=late)
    assert [str(label) for label in cases.labels[:2]] == ["a, sine, 0 mbar", "a, sine, 0 mbar, late"]
    assert [label.course for label in cases.labels] == ["sine", "sine, late", "hold", "hold, late"]
    np.testing.assert_array_equal(cases.scenarios.disturbances[0].delay, [0.0, 0.004] * 2)
    np.testing.assert_array_equal(cases.scenarios.sensors.position.noise, [8e-6, 2e-5] * 2)
    # Without a late duty in both, they are not of one structure.
    late[""] = Variant()
    with pytest.raises(vgtjax.InputError, match="variants must be models of one structure"):
        cross_cases({"a": actuator}, REFERENCES, duration=0.1, variants=late)


def test_cases_that_cannot_be_crossed_are_refused(actuator):
    with pytest.raises(vgtjax.InputError, match="at least one plant, one reference and one turbine pressure"):
        cross_cases({"a": actuator}, {}, duration=1.0)
    other = vgtjax.Actuator(friction=vgtjax.Coulomb())
    with pytest.raises(vgtjax.InputError, match="models of one structure, but their components or settings differ"):
        cross_cases({"a": actuator, "b": other}, REFERENCES, duration=1.0)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"tracking": 0.0}, "tracking of an objective must be positive, but it is 0.0; correct it"),
        ({"worst": 1.5}, "worst of an objective must be within 0 and 1"),
        ({"power": 0.5}, "power of an objective must be one or more"),
        ({"quantile": 0.0}, "quantile of an objective must be above 0 and at most 1, but it is 0.0; correct it"),
    ],
)
def test_an_objective_without_sense_is_refused(settings, sentence):
    with pytest.raises(vgtjax.InputError, match=sentence):
        Objective(**settings)


@pytest.mark.parametrize("kept", [1.0, 0.5, 0.0])
def test_derivatives_fade_geometrically_and_values_not_at_all(kept):
    """`x' = a x` ten times: `d x10/da` is the sum of `a^9 kept^k`, which is `10 a^9` when nothing fades."""

    def last(a):
        x = jnp.asarray(1.0)
        for _ in range(10):
            x = a * fade(x, jnp.asarray(kept))
        return x

    value, slope = jax.jvp(last, (jnp.asarray(1.1),), (jnp.asarray(1.0),))
    assert float(value) == pytest.approx(1.1**10, rel=1e-12)
    assert float(slope) == pytest.approx(1.1**9 * sum(kept**k for k in range(10)), rel=1e-12)


def test_a_memory_of_derivatives_must_be_positive(actuator):
    scenario = control.Scenario(Constant(0.005))
    with pytest.raises(vgtjax.InputError, match=r"derivative_memory must be positive, but it is 0\.0 s; use e\.g\. 1"):
        control.close_loop(actuator, PI(), scenario, 0.1, derivative_memory=0.0)


def test_a_start_outside_the_conditions_is_refused(actuator):
    edge = vgtjax.replace_parameters(FrictionCompensation(), {"derivative_gain": 63.0})
    with pytest.raises(vgtjax.InputError, match=r"every condition of the design .* 'derivative_gain above its bound"):
        plan_tuning(edge, cross_cases({"a": actuator}, REFERENCES, duration=0.1), OBJECTIVE)


def test_runs_that_are_over_before_they_count_are_refused(actuator):
    cases = cross_cases({"a": actuator}, REFERENCES, duration=0.1)
    with pytest.raises(vgtjax.InputError, match=r"before the end of runs after 0\.1 s, but it is 2 s; correct it"):
        plan_tuning(PI.for_plant(actuator), cases, Objective())


def test_a_problem_without_gains_is_refused(actuator):
    cases = cross_cases({"a": actuator}, REFERENCES, duration=0.1)
    with pytest.raises(vgtjax.InputError, match="at least one free gain, but free and fixed leave none; free one"):
        plan_tuning(PI.for_plant(actuator), cases, OBJECTIVE, free=["integral_gain"], fixed=["*"])


def test_a_closed_loop_whose_derivatives_overflow_says_nothing_of_the_gains(actuator, monkeypatch):
    """Of two closed loops one has overflowed; the other one is moved by the first gain only."""
    bends = np.stack([np.full((2, 2), np.nan), np.diag([2.0, 0.0])])
    found = SimpleNamespace(slopes=np.zeros((2, 2)), curvatures=bends)
    found.finite = Linearisation.finite.fget(found)
    assert found.finite.tolist() == [False, True]
    monkeypatch.setattr(TuningProblem, "linearise", lambda *_: found)
    cases, objective = cross_cases({"a": actuator}, REFERENCES, duration=0.2), Objective(settled=0.1)
    problem = plan_tuning(PI(), cases, objective, free=["proportional_gain", "integral_gain"])
    assert problem.moves_errors(problem.start).tolist() == [True, False]
