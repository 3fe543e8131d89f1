"""The main claim, on traces of an independent plant: fitted on five, the model meets two that it has not seen."""

import gzip

import numpy as np
import pytest
from support import DATA, EXAMPLE

import vgtjax
from vgtjax.estimation import calibrate, plan_task


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example")
    (folder / "ramp.csv").write_bytes(gzip.decompress((DATA / "ramp.csv.gz").read_bytes()))
    names = ("step_50", "step_80", "step_100", "levels_1", "pyramid")
    fit = [vgtjax.load_trace(EXAMPLE / f"{name}.csv") for name in names]
    unseen = [vgtjax.load_trace(EXAMPLE / "levels_2.csv"), vgtjax.load_trace(folder / "ramp.csv")]
    return calibrate(plan_task(vgtjax.Actuator(), fit, unseen))


def test_it_converges_from_the_printed_values_to_the_noise(calibration):
    assert calibration.progress.converged
    assert calibration.uncertainty.scale == pytest.approx(1.0, abs=0.05)
    assert calibration.uncertainty.estimable.all()
    assert len(calibration.values) == 26


@pytest.mark.parametrize("name", ["levels_2", "ramp"])
def test_traces_that_it_has_not_seen_are_met_to_the_noise(calibration, name):
    """The project's limits; the sensors alone make 8 um and 60 Pa."""
    result = next(result for result in calibration.traces if result.trace.name == name)
    assert result.use == "validate"
    assert result.rmse["x_d"] <= 12e-6
    assert result.rmse["p_act"] <= 90.0


def test_residuals_look_white(calibration):
    for result in calibration.traces:
        for channel in ("x_d", "p_act"):
            residual = getattr(result.trace, channel) - result.simulated[channel]
            residual = residual - residual.mean()
            for lag in (1, 2, 5, 20, 100):
                correlation = residual[lag:] @ residual[:-lag] / (residual @ residual)
                # White noise of n samples stays within 4/sqrt(n) = 0.03 to 0.06; the ramp leaves a little more.
                assert abs(correlation) < max(4 / np.sqrt(len(residual)), 0.07)
