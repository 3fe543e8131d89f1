"""The polynomial flow map from what sensors see of a simulated run."""

import numpy as np
import pytest

import vgtjax
from vgtjax.experiments import deviation, validation_traces
from vgtjax.identification.pneumatic._flow_map import fit_measured_flow, measured_flow
from vgtjax.parts import PolynomialFlow

FULL = vgtjax.Actuator()
TRUTH = PolynomialFlow()
LEVELS = np.array([0, 35, 60, 80, 50, 20, 70, 100, 40, 0], float)
TIME = np.arange(0, 8, 1e-3)
PWM = LEVELS[(TIME / 0.8).astype(int)]


def recorded(model, seed):
    """A run with the noise of sensors: 1 mbar and 10 um."""
    trace = vgtjax.Trace(TIME, pwm=PWM, p_res=np.full_like(TIME, 2e4), name="levels")
    run, noise = vgtjax.simulate(model, trace), np.random.default_rng(seed)
    return run, trace.replace(
        p_act=np.asarray(run.p_act) + noise.normal(0, 100, TIME.shape),
        x_d=np.asarray(run.x_d) + noise.normal(0, 1e-5, TIME.shape),
    )


@pytest.fixture(scope="module")
def bench():
    """Of four states whose map is the default polynomial."""
    return recorded(vgtjax.reduce_to_static_map(FULL, TRUTH), seed=0)


def test_measured_flow_is_the_models_own(bench):
    run, trace = bench
    flow, error = measured_flow(FULL, trace)
    calm = np.ones_like(TIME, bool)
    for change in 0.8 * np.arange(1, 10):
        calm &= np.abs(TIME - change) > 0.1  # corners of the pressure, which smoothing cuts
    missed = (flow - (run.m_dot_in - run.m_dot_out))[calm]
    # Noise, and the choice among windows that noise makes.
    assert np.sqrt(np.mean((missed / error[calm]) ** 2)) < 3
    assert np.sqrt(np.mean(missed**2)) < 0.01 * np.max(np.abs(flow))


def test_the_map_of_four_states_is_found_again(bench):
    fit = fit_measured_flow(FULL, [bench[1]])
    pressure, duty = np.linspace(4e4, 1e5, 7), np.linspace(0, 100, 7)
    error = np.asarray(fit.flow_map(duty, pressure) - TRUTH(duty, pressure))
    # Noise of 1 mbar at a kilohertz; measured: 1e-6 of 3e-4 kg/s.
    assert np.max(np.abs(error)) < 4e-6
    assert fit.r_squared > 0.99
    assert fit.duty_range == (0, 100)
    assert fit.reservoir == 2e4


def test_fitted_to_a_trace_the_polynomial_follows_the_full_model():
    fit = fit_measured_flow(FULL, [recorded(FULL, seed=1)[1]])
    # The full model's air cools and its flow is no polynomial: 0.86 was measured, and 22 to 26 mbar on the steps.
    assert 0.8 < fit.r_squared < 0.95
    model = vgtjax.reduce_to_static_map(FULL, fit.flow_map)
    for trace in validation_traces(interval=2e-3)[:2]:
        assert deviation(model, FULL, trace).pressure_rmse < 3500
    flow_map = fit.flow_map
    assert flow_map.duty[1] < 0  # the other curvature than the map of the grid, with the same inversion
    assert flow_map.duty_for(flow_map(45.0, 7e4), 7e4) == pytest.approx(45.0, abs=1e-9)


@pytest.mark.parametrize("column", ["pwm", "p_act", "x_d"])
def test_a_trace_without_what_it_takes_is_refused(column, bench):
    with pytest.raises(vgtjax.InputError, match=f"levels: a measured flow needs the column {column}, which is missing"):
        fit_measured_flow(FULL, [bench[1].replace(**{column: None})])


def test_two_duties_are_not_enough(bench):
    with pytest.raises(vgtjax.InputError, match="needs traces with three duties or more, but these have 2; record"):
        fit_measured_flow(FULL, [bench[1].window(0.0, 1.5)])
    with pytest.raises(vgtjax.InputError, match="these have 0; record"):
        fit_measured_flow(FULL, [])
