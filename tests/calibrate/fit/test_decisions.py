"""What a report decides of a fit, whatever the order of its traces."""

import itertools
import types

import numpy as np
import pytest

from calibrate.fit.decisions import _of_the_fit

RATIOS, FAILED = {("a", "x_d"): 1.0, ("b", "x_d"): np.nan, ("c", "x_d"): 1.02}, "b"


@pytest.mark.parametrize("order", list(itertools.permutations(RATIOS)))
def test_a_trace_whose_simulation_failed_is_the_worst(order):
    """Its ratio is no number, and `max` passed by one that was not the first: the healthy trace was kept."""
    certificate = types.SimpleNamespace(mismatches=[1e-3], alone={}, modes=[1e-9], repeated=1e-6)
    uncertainty = types.SimpleNamespace(gain=0.0)
    ratios = {each: RATIOS[each] for each in order}
    ends = [types.SimpleNamespace(trace=types.SimpleNamespace(name=name), failed=name == FAILED) for name, _ in order]
    calibration = types.SimpleNamespace(uncertainty=uncertainty, noise_ratios=ratios, traces=ends)
    *_, worst = _of_the_fit(types.SimpleNamespace(calibration=calibration, certificate=certificate))
    assert (worst.what, worst.verdict) == ("worst trace: x_d of b", "exceeded")
