"""A population of nozzles: they vary where the study says so, and each sample has a table of its own."""

import numpy as np
import pytest
from commands import read, run_command
from population_study import LEAD, PRELOAD, nozzle_study
from support import quick_nozzle

import vgtjax
from vgtjax.experiments import SlowLoop
from vgtjax.population import Evaluator, choose_factors, spread_population

STUDY = nozzle_study(0.3, "[2e5]", "[tolerance]\nsamples = 4\n")


@pytest.fixture(scope="module", autouse=True)
def _quick():
    with quick_nozzle():
        yield


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("nozzles")
    (folder / "study.toml").write_text(STUDY)
    outcome = run_command("tolerance", folder / "study.toml", "--out", folder / "out")
    assert (outcome.status, outcome.err) == (0, "")
    return folder / "out"


def test_nothing_of_a_nozzle_varies_unless_the_study_says_so():
    names = spread_population(vgtjax.Actuator(vane_force=vgtjax.Turbine())).factors.entries
    assert PRELOAD in names
    assert not [name for name in names if name.startswith("vane_force.")]


def test_each_sample_is_simulated_with_the_table_of_its_own_nozzle(out):
    with np.load(out / "samples.npz") as samples:
        assert samples["quantities"].tolist() == [PRELOAD, LEAD]
        values, names = samples["values"], samples["output_names"].tolist()
        widths = samples["outputs"][:, names.index("hysteresis_2000mbar")]
        assert samples["failed"].size == 0
    plant, loop = vgtjax.Actuator(vane_force=vgtjax.Turbine()), SlowLoop((2e5,), seconds=4.0)
    trace = loop.traces[0]
    for row, width in zip(values, widths, strict=True):
        own = vgtjax.replace_parameters(plant, dict(zip([PRELOAD, LEAD], row, strict=True)))
        alone = vgtjax.simulate(own, trace)
        read_off = loop.read(alone.x_d[None], alone.p_act[None], own.air.pressure)["hysteresis_2000mbar"]
        # The same program on other numbers, but for the order of sums: in mbar.
        assert width == pytest.approx(float(read_off) / 100, rel=1e-6)


def test_the_summary_has_both(out):
    assert set(read(out / "summary.json")["quantities"]) == {LEAD, PRELOAD}


def test_samples_whose_throat_is_closed_fail_by_that_name_and_touch_no_other():
    """At 4 deg of the vanes the throat is 0.591 mm with vanes of 0.3 mm, so that 0.89 mm close it."""
    plant, name = vgtjax.Actuator(vane_force=vgtjax.Turbine()), "vane_force.nozzle.thickness"
    factors = choose_factors(plant, [name])
    thickness = np.array([0.3e-3, 2e-3, 0.85e-3, 0.88e-3, 0.95e-3, 40e-3])[:, None]
    good = np.array([True, False, True, False, False, False])  # 0.01 mm is less than a thousandth of the spacing
    evaluator = Evaluator(plant, factors, [SlowLoop((1e5,), seconds=4.0)], lanes=6)
    found = evaluator(thickness)
    assert found.causes == tuple("successful" if each else "no_steady_flow" for each in good)
    assert np.all(np.isnan(found.matrix[~good]))
    alone = Evaluator(plant, factors, [SlowLoop((1e5,), seconds=4.0)], lanes=6)(np.tile(thickness[[0]], (6, 1)))
    np.testing.assert_array_equal(found.matrix[0], alone.matrix[0])
    slopes = evaluator.gradient(thickness).matrix
    defined = np.isfinite(found.matrix[good])
    assert np.all(np.isfinite(slopes[good][defined]))
    assert np.all(np.isnan(slopes[~good]))
