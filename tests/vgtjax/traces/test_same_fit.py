"""One campaign is one fit, whatever the files that it was recorded in."""

import pathlib

import numpy as np
import pytest
from recorded import STEPS, UNITS, WRITERS, Campaign, Signal, sources_for
from support import EXAMPLE

import vgtjax
from vgtjax.estimation import Unknown
from vgtjax.traces import STANDARD_ATMOSPHERE

FREE = ("diaphragm.stiffness", "diaphragm.preload")
"""Not friction: where the rod comes to rest is a kink, and a search ends there within a hundredth of a standard error,
by rounding."""
FACTORS = {"%": 1.0, "mbar gauge": 100.0, "mm": 1e-3}
FINE = {name: 0.01 * step for name, step in STEPS.items()}
PLAIN = Unknown(duty_delay=False, duty_hold=False, noise="white", loss="gaussian", numerics=False)
"""A search for the parameters only, in a tenth of the time."""
BINARY = [name for name in WRITERS if name != "run.csv"]


def quantised(slow: int = 1) -> Campaign:
    """The beginning of a step of the example in counts of a converter; position and reservoir every `slow` samples."""
    trace, found = vgtjax.load_trace(EXAMPLE / "step_80.csv").window(0.45, 0.601), {}
    for name, unit in UNITS.items():
        every = slow if name in ("x_d", "p_res") else 1
        gauge = STANDARD_ATMOSPHERE if unit == "mbar gauge" else 0.0
        values = (trace.channels[name].value[::every] - gauge) / FACTORS[unit]
        counts = np.round(values / FINE[name]).astype("i4")
        found[name] = Signal(np.arange(len(counts)) * every * 1e-3, counts, FINE[name], unit)
    return found


def fit_of(path: pathlib.Path, signals: Campaign) -> np.ndarray:
    WRITERS[path.name](path, signals)
    trace = vgtjax.load_trace(path, channels=sources_for(path, signals), name="run")
    start = vgtjax.replace_parameters(vgtjax.Actuator(), {"diaphragm.stiffness": 11000.0})
    found = vgtjax.fit(start, [trace], free=FREE, unknown=PLAIN)
    assert found.converged
    return np.asarray(found.values)


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> dict[int, np.ndarray]:
    """The fit of the campaign as CSV, and of that with two clocks as MDF 4."""
    folder = tmp_path_factory.mktemp("reference")
    return {1: fit_of(folder / "run.csv", quantised()), 5: fit_of(folder / "run.mf4", quantised(5))}


@pytest.mark.parametrize("name", BINARY)
def test_one_rate(tmp_path, reference, name):
    # The last bits of times and values differ, as some files have counts and others text.
    np.testing.assert_allclose(fit_of(tmp_path / name, quantised()), reference[1], rtol=1e-9)


@pytest.mark.parametrize("name", ["run.mdf", "run.tdms", "run.mat", "run_73.mat", "run.parquet"])
def test_two_rates(tmp_path, reference, name):
    np.testing.assert_allclose(fit_of(tmp_path / name, quantised(5)), reference[5], rtol=1e-9)


def test_they_are_fits_of_their_own(reference):
    """Fewer samples of the position are another fit, of the same spring."""
    assert np.all(reference[1] != reference[5])
    assert reference[5][1] == pytest.approx(reference[1][1], rel=0.01)  # what is left of the noise in 0.15 s
