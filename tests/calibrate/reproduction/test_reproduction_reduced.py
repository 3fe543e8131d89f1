"""The rows on the models for control: along simulated traces, against the full model, and the printed flow map."""

import numpy as np
import pytest
from thesis_examples import OF_THE_EXAMPLE

from calibrate.reproduction import figures, reduced_models
from calibrate.reproduction.reduced_models import MODELS, ROWS, TRACES
from vgtjax.traces import noise_level


@pytest.fixture(scope="module")
def results():
    return {row.id: row.evaluate() for row in ROWS}


def test_every_model_has_its_error_on_both_steps_and_the_ramp(results):
    for signal in ("pressure", "position"):
        for trace in TRACES:
            assert len(results[f"example-{signal}-{trace}"].ours) == len(MODELS)


@pytest.mark.parametrize("trace", TRACES)
def test_the_full_model_is_that_of_the_example(trace):
    """Its parameters come from another trace: what is left is the noise of the sensors, 0.6 mbar and 8 um."""
    found = reduced_models.along(trace)
    full = found.deviations["full"]
    # A third more at most: what a fit to one staircase leaves undetermined. Seen: 1.32 and 1.14.
    assert full.pressure_rmse < 1.4 * noise_level(found.measured.p_act, "p_act")
    assert full.position_rmse < 1.4 * noise_level(found.measured.x_d, "x_d")


@pytest.mark.parametrize("trace", TRACES)
def test_both_reductions_miss_the_heat(trace):
    six, four = (reduced_models.along(trace).deviations[name] for name in MODELS[1:])
    # Not noise, and not far: the thesis reads 5 to 8 mbar of steady error off its figures, the transient is more.
    for found in (six, four):
        assert 300 < found.pressure_rmse < 2000
    # Heat is what both leave out; what only one does is a part of that. Seen: 1 % and 9 %.
    assert four.pressure_rmse == pytest.approx(six.pressure_rmse, rel=0.05)
    assert four.position_rmse == pytest.approx(six.position_rmse, rel=0.15)


BOUNDS = {"pressure-80": 5.0, "position-80": 0.3, "pressure-50": 8.0, "position-50": 0.3}
"""mbar and mm, of section 5.2.3."""


@pytest.mark.parametrize("step", BOUNDS)
def test_static_errors_of_all_three_are_those_of_an_independent_plant(step, results):
    """With the fitted values; a thirtieth of the bounds of the thesis at the most."""
    result, derived = results[f"static-{step}-reduced"], OF_THE_EXAMPLE[f"static-{step}-reduced"]
    assert result.ours == pytest.approx(derived.value(), abs=derived.abs)
    assert max(map(abs, result.ours)) < BOUNDS[step] / 30
    assert "meets the bound" in result.reason
    assert result.verdict == "not reproducible"


def test_without_heat_the_map_is_nearly_the_full_model():
    whole, warm = (reduced_models.simplification(isothermal=flag) for flag in (False, True))
    for step in range(3):
        # Six states keep the plunger, whose lag makes most of what four states add on a step.
        assert warm["six states"][step].pressure_rmse < 0.1 * whole["six states"][step].pressure_rmse
        assert warm["four states"][step].pressure_rmse < 0.3 * whole["four states"][step].pressure_rmse


def test_air_that_does_not_cool_is_evacuated_more_slowly(results):
    for signal in ("pressure", "position"):
        full, *reduced = results[f"validation-response-{signal}"].ours
        assert min(reduced) > 1.1 * full


def test_the_printed_map_has_its_zero_beside_equilibrium(results):
    """By NumPy: the root of phi + u psi nearest to zero, in mbar."""
    phi = np.array([-7.94e-6, -4.92e-7, -5.94e-10, -2.48e-12, 5.65e-15, 1.59e-18])
    psi = np.array([5.19e-7, -5.27e-8, 3.13e-10, -1.13e-13, -4.42e-16, 0.0])
    result = results["flow-map-equilibrium"]
    for share, ours in zip((0.0, 0.5, 1.0), result.ours, strict=True):
        roots = np.polynomial.Polynomial(phi + share * psi).roots()
        nearest = min(roots[np.abs(roots.imag) < 1e-9].real, key=abs)
        assert ours == pytest.approx(nearest, abs=1e-6)
    assert result.verdict == "differs"


def test_the_plunger_answers_in_what_the_thesis_says(results):
    assert results["plunger-time"].verdict == "met with our inputs"
    # b_p / k_mem is 11 ms, and nine tenths of the stroke are two time constants and a bit; the mass adds 0.5 ms.
    assert results["plunger-time"].ours == pytest.approx(0.02, abs=2e-3)


def test_maps_explain_less_than_the_thesis_says_and_a_table_all(results):
    result = results["flow-map-goodness"]
    assert result.ours < reduced_models.GOODNESS
    assert "plunger's rest 0.9999" in result.reason


def test_the_picture_shows_every_model_on_every_trace():
    figure = figures.validation_figure()
    names = [curve.name for curve in figure.data]
    assert names.count("trace") == 2 * len(TRACES)
    for model in MODELS:
        assert names.count(model) == 3 * len(TRACES)
    assert all(np.all(np.isfinite(curve.y)) for curve in figure.data)
