"""Mechanical identifications: known parameters come back within their errors, and what is not determined is said."""

import importlib
import re

import numpy as np
import pytest
import support
from support import duty_trace, rms

import vgtjax
from vgtjax.identification import (
    apply,
    identify_axis,
    identify_dahl,
    identify_lugre,
    identify_mass_and_damping,
    identify_spring,
)
from vgtjax.identification.mechanical._mechanical_fit import NO_DERIVATIVES, fit_response, mechanical_fit
from vgtjax.identification.mechanical._motion import mechanical_half, read_motions

TRUTH = {
    "diaphragm.mass": 0.55,
    "diaphragm.preload": 51.3,
    "diaphragm.stiffness": 12700.0,
    "diaphragm.travel": 9.9e-3,
    "diaphragm.stop_stiffness": 1.03e6,
    "friction.static_force": 3.9,
    "friction.coulomb_force": 3.3,
    "friction.bristle_stiffness": 36000.0,
    "friction.bristle_damping": 390.0,
    "friction.viscous_damping": 231.0,
    "friction.stribeck_velocity": 0.8e-3,
}
WORST = {
    "diaphragm.mass": 0.1,
    "diaphragm.preload": 2e-3,
    "diaphragm.stiffness": 1e-3,
    "diaphragm.travel": 1e-3,
    "diaphragm.stop_stiffness": 0.1,
    "friction.static_force": 0.1,
    "friction.coulomb_force": 0.03,
    "friction.bristle_stiffness": 0.15,
    "friction.bristle_damping": 0.1,
    "friction.viscous_damping": 0.02,
    "friction.stribeck_velocity": 0.3,
}
"""Largest relative standard errors that still are a result."""
LEVELS = ((0, 0.2), (85, 0.9), (45, 0.7), (60, 0.5), (30, 0.8), (55, 0.6), (50, 0.5), (95, 1.0), (40, 0.8))
LEVELS += ((48, 0.6), (35, 0.6), (0, 0.8))
SECONDS = 8.0


def bench(model, seed, trace, offset=(2e-5, -150.0)):
    """What a bench would record: noise, and an offset of each sensor."""
    run = vgtjax.simulate(model, trace)
    random = np.random.default_rng(seed)
    return trace.replace(
        x_d=np.asarray(run.x_d) + offset[0] + random.normal(0, 8e-6, len(trace.time)),
        p_act=np.asarray(run.p_act) + offset[1] + random.normal(0, 60, len(trace.time)),
    )


@pytest.fixture(scope="module")
def real():
    return vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH)


@pytest.fixture(scope="module")
def levels(real):
    return bench(real, 1, duty_trace(*LEVELS, p_res=2.0e4))


@pytest.fixture(scope="module")
def slow(real):
    """A slow triangle of the duty, as long as the levels."""
    time = np.arange(0, SECONDS, 1e-3)
    duty = 80 * (1 - np.abs(2 * time / SECONDS - 1))
    return bench(real, 2, vgtjax.Trace(time=time, pwm=duty, p_res=np.full_like(time, 2e4)))


@pytest.fixture(scope="module")
def found(levels):
    """Every test, each on what the earlier ones found, from the printed values."""
    model, results = vgtjax.Actuator(), {}
    for test in (identify_spring, identify_mass_and_damping, identify_lugre, mechanical_fit):
        results[test.__name__] = test(model, [levels])
        model = apply(model, results[test.__name__])
    return results


def assert_recovered(result, names, truth=TRUTH, worst=WORST):
    support.assert_recovered(result, {name: truth[name] for name in names}, worst)


# -- each test on a simulated run whose parameters are known -----------------------------------------------------------


def test_the_spring(found):
    result = found["identify_spring"]
    assert_recovered(result, ["diaphragm.preload", "diaphragm.stiffness", "diaphragm.travel"], worst=WORST)
    assert (result.equations, result.limitations) == ("2.36", ())
    (curve,) = result.figures
    # The line runs through the middle of both branches, friction of 3 to 4 N on either side.
    spring = np.interp(curve.points[0], *curve.line)
    for branch in (curve.points[1] > spring, curve.points[1] < spring):
        assert 2.8 < np.mean(np.abs(curve.points[1] - spring)[branch]) < 4.5


def test_mass_and_damping(found):
    result = found["identify_mass_and_damping"]
    assert_recovered(result, ["diaphragm.mass", "friction.viscous_damping"])
    printed = re.search(r"Natural frequency (\S+) rad/s, damping ratio (\S+)\.$", result.method)
    assert printed is not None
    mass, damping = (float(value) for value in result.values.values())
    assert float(printed[1]) == pytest.approx(np.sqrt(12700 / mass), rel=2e-3)
    assert float(printed[2]) == pytest.approx(damping / (2 * np.sqrt(12700 * mass)), rel=5e-3)


def test_lugre_friction(found):
    result = found["identify_lugre"]
    assert_recovered(result, [name for name in TRUTH if name.startswith("friction.")])
    assert [curve.title for curve in result.figures] == ["friction over velocity", "friction over position"]
    velocity, path = result.figures
    law = np.interp(velocity.points[0], *velocity.line)
    fast = np.abs(velocity.points[0]) > 1.0  # mm/s: a line over velocity jumps at zero
    assert np.std(velocity.points[1][fast] - law[fast]) < 0.1
    assert np.std(path.points[1] - path.line[1]) < 0.2


def test_everything_at_once(found):
    result = found["mechanical_fit"]
    assert_recovered(result, TRUTH)
    (curve,) = result.figures
    assert rms(curve.points[1] - curve.line[1]) < 10e-3  # mm


def test_wrong_starts_end_in_the_same_place(levels, found):
    wrong = {
        "diaphragm.mass": 2.5,
        "diaphragm.preload": 25.0,
        "diaphragm.stiffness": 7000.0,
        "friction.static_force": 8.0,
        "friction.coulomb_force": 7.0,
        "friction.bristle_stiffness": 9000.0,
        "friction.viscous_damping": 90.0,
    }
    model = vgtjax.replace_parameters(vgtjax.Actuator(), wrong)
    for test in (identify_spring, identify_lugre, mechanical_fit):
        result = test(model, [levels])
        model = apply(model, result)
    for name, value in found["mechanical_fit"].values.items():
        # Where a fit stops, within a tenth of an error, depends on where it comes from.
        assert float(result.values[name]) == pytest.approx(
            float(value), abs=0.2 * float(found["mechanical_fit"].std_errors[name])
        )


def test_dahl_friction():
    truth = {"friction.coulomb_force": 3.4, "friction.bristle_stiffness": 31000.0}
    values = {name: value for name, value in TRUTH.items() if name.startswith("diaphragm.")}
    real = vgtjax.replace_parameters(vgtjax.Actuator(friction=vgtjax.Dahl()), {**values, **truth})
    trace = bench(real, 3, duty_trace(*LEVELS, p_res=2.0e4))
    result = identify_dahl(vgtjax.Actuator(friction=vgtjax.Dahl()), [trace])
    assert_recovered(result, truth, truth)
    assert result.figures[0].title == "friction over position"


# -- what is not determined --------------------------------------------------------------------------------------------


def test_dahls_one_level_is_none_of_two(levels):
    far_apart = {"friction.coulomb_force": 2.0, "friction.static_force": 12.0}
    result = identify_dahl(vgtjax.replace_parameters(vgtjax.Actuator(), far_apart), [levels])
    assert "friction.coulomb_force" not in result.values
    (said,) = [each for each in result.limitations if each.startswith("friction.coulomb_force")]
    assert "has a static force that is 10 N above it; identify friction that has both" in said


def test_slow_motion_does_not_determine_what_needs_other_motion(slow):
    result = mechanical_fit(vgtjax.Actuator(), [slow])
    assert "diaphragm.mass: not determined by these traces; record duty steps at 1 kHz" in result.limitations
    sentence = (
        "friction.stribeck_velocity: not determined by these traces; record motion at different speeds below 5 mm/s"
    )
    assert sentence in result.limitations
    assert not {sentence.partition(":")[0] for sentence in result.limitations} & set(result.values)
    for name, value in result.values.items():
        assert abs(float(value) - TRUTH[name]) < 4 * float(result.std_errors[name]), name


def test_what_is_not_determined_has_the_models_values_wherever_a_search_begins(slow):
    """Else what is determined would belong to values that nothing reports, and that the model does not have."""
    half = mechanical_half(vgtjax.Actuator())
    begin = vgtjax.replace_parameters(half, {"friction.bristle_damping": 300.0, "friction.coulomb_force": 3.6})
    response = fit_response(half, read_motions(half, [slow]), begin)
    assert "friction.bristle_damping" in response.not_determined
    for name in response.not_determined:
        value = float(vgtjax.get_parameter(half, name))
        # A value goes through its logarithm and back.
        assert float(vgtjax.get_parameter(response.model, name)) == pytest.approx(value, rel=1e-12)
    assert abs(response.values["diaphragm.stiffness"] - 12700) < 4 * response.std_errors["diaphragm.stiffness"]


def test_a_mixture_of_values_that_fails_is_no_end(slow, monkeypatch):
    """What was fitted beside parameters that return to the model's values need not go with those."""
    module = importlib.import_module("vgtjax.identification.mechanical._mechanical_fit")
    calls, real = [], module.start_calibration

    def second_fails(task):
        calls.append(task.model)
        if len(calls) == 2:
            raise vgtjax.SimulationError("the simulation with the start values fails")
        return real(task)

    half = mechanical_half(vgtjax.Actuator())
    begin = vgtjax.replace_parameters(half, {"friction.bristle_damping": 300.0, "diaphragm.stiffness": 12650.0})
    monkeypatch.setattr(module, "start_calibration", second_fails)
    response = fit_response(half, read_motions(half, [slow]), begin)
    assert float(calls[2].friction.bristle_damping) == 429.77  # not determined: the model's
    assert float(calls[2].diaphragm.stiffness) == 12650.0  # determined: where the search began
    assert abs(response.values["diaphragm.stiffness"] - 12700) < 4 * response.std_errors["diaphragm.stiffness"]


def test_a_fit_that_ends_in_chaos_tells_nothing(slow, monkeypatch):
    """Rods too light for their bristles have derivatives of 1e69 and more, and so errors of nothing.

    Here every fit exceeds the limit: whether a real one ends in chaos hangs on 1e-9 Pa.
    """
    monkeypatch.setattr("vgtjax.identification._limits.SENSITIVITY", 1e-3)
    result = mechanical_fit(vgtjax.Actuator(), [slow])
    assert (result.values, result.limitations) == ({}, (NO_DERIVATIVES,))


def test_a_rod_at_rest_tells_nothing(real):
    still = bench(real, 4, duty_trace((0, 0.5), (10, 1.0), p_res=2.0e4))
    model = vgtjax.Actuator()
    for test in (identify_spring, identify_dahl):
        result = test(model, [still])
        assert (result.values, len(result.limitations)) == ({}, 1)
        assert result.limitations[0].startswith("the rod never ")
    for test in (identify_mass_and_damping, identify_lugre, mechanical_fit):
        assert test(model, [still]).values == {}
        assert test(model, [still.replace(x_d=None)]).limitations == (
            "no trace shows the rod move under a measured drive; record x_d together with p_act or f_drive",
        )


def test_one_direction_does_not_distinguish_preload_from_friction(levels):
    closing = levels.window(0.0, 1.05)
    result = identify_spring(vgtjax.Actuator(), [closing])
    assert "diaphragm.preload" not in result.values
    assert (
        "diaphragm.preload: the rod does not slide in both directions; record it moving out and back"
        in result.limitations
    )


def test_a_trace_without_rest_tells_stiffness_but_hardly_preload(levels):
    moving = levels.window(1.2, 7.0)
    result = identify_spring(vgtjax.Actuator(), [moving])
    assert abs(result.values["diaphragm.stiffness"] - 12700) < 4 * result.std_errors["diaphragm.stiffness"]
    assert float(result.std_errors["diaphragm.preload"]) > 1.0  # N: half of the 50 mbar that a sensor may be off


@pytest.mark.parametrize("samples", [2, 9, 60])
def test_a_short_trace_tells_nothing(levels, samples):
    short = levels.window(0.9995, 0.9999 + samples * 1e-3)
    for test in (identify_spring, identify_dahl, identify_axis):
        result = test(vgtjax.Actuator(), [short])
        assert (result.values, len(result.limitations)) == ({}, 1)


def test_other_friction_has_no_lugre_parameters(levels):
    result = identify_lugre(vgtjax.Actuator(friction=vgtjax.Coulomb()), [levels])
    assert result.limitations == ("the model's friction is not LuGre's; choose a model with LuGre friction",)
