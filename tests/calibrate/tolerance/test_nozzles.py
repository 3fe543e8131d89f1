"""A population of nozzles: they vary where the study says so, and each sample has a table of its own."""

import numpy as np
import pytest
from commands import read, run_command
from support import quick_nozzle

import vgtjax
from vgtjax.experiments import SlowLoop
from vgtjax.population import spread_population

LEAD, PRELOAD = "vane_force.nozzle.lead", "diaphragm.preload"
STUDY = f"""[components]
vane_force = "turbine"
[population]
vary = []
[population.parameters]
"{LEAD}" = {{relative = 0.3}}
"{PRELOAD}" = {{relative = 0.01}}
[experiments]
turbine_pressure = [2e5]
loop_seconds = 4
steps = []
[tolerance]
samples = 4
"""


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
