"""Models beside a trace whose sensors have offsets."""

import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax.experiments import Deviation, deviation, validate

FULL = vgtjax.Actuator()
FOUR = vgtjax.reduce_to_static_map(FULL)
OFFSETS = {"p_act": 300.0, "x_d": -6e-5}
NOISE = {"p_act": 60.0, "x_d": 8e-6}


@pytest.fixture(scope="module")
def recorded():
    """A step of the full model as sensors see it, and the step itself."""
    trace = duty_trace((0, 0.05), (60, 0.4), p_res=2.0e4)
    run, rng = vgtjax.simulate(FULL, trace), np.random.default_rng(0)
    seen = {
        name: np.asarray(getattr(run, name)) + OFFSETS[name] + NOISE[name] * rng.standard_normal(len(trace.time))
        for name in OFFSETS
    }
    return run, trace.replace(**seen)


def test_the_first_model_tells_the_offsets_and_leaves_the_noise(recorded):
    run, trace = recorded
    found = validate({"full": FULL, "four": FOUR}, trace)
    assert list(found.solutions) == list(found.deviations) == ["full", "four"]
    for name, noise in NOISE.items():
        # Five standard errors of a mean over 450 samples.
        left = np.mean(getattr(found.measured, name) - np.asarray(getattr(run, name)))
        assert abs(left) < 5 * noise / np.sqrt(len(trace.time))
    full, four = found.deviations.values()
    # Three standard errors of a deviation from as many samples.
    assert full.pressure_rmse == pytest.approx(NOISE["p_act"], rel=3 / np.sqrt(2 * 450))
    assert full.position_rmse == pytest.approx(NOISE["x_d"], rel=3 / np.sqrt(2 * 450))
    # Independent of the model's error, so their squares add.
    own = deviation(FOUR, FULL, trace)
    assert four.pressure_rmse == pytest.approx(np.hypot(own.pressure_rmse, NOISE["p_act"]), rel=0.02)
    assert four.position_rmse == pytest.approx(np.hypot(own.position_rmse, NOISE["x_d"]), rel=0.02)


def test_a_deviation_is_root_mean_square_and_peak_of_a_difference(recorded):
    run, trace = recorded
    found = Deviation.between(run, trace)
    error = np.asarray(run.p_act) - trace.p_act
    assert found.pressure_rmse == pytest.approx(rms(error))
    assert found.pressure_peak == pytest.approx(np.max(np.abs(error)))
    assert deviation(FULL, FULL, trace) == Deviation(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("column", ["x_d", "p_act"])
def test_a_trace_without_what_is_compared_is_refused(column, recorded):
    trace = recorded[1].replace(**{column: None}, name="half")
    with pytest.raises(vgtjax.InputError, match="half: a validation needs the columns x_d and p_act, but one of them"):
        validate({"full": FULL}, trace)
