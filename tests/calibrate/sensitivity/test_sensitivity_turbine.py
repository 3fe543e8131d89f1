"""The command `sensitivity` on a population of nozzles, whose tables take no flows here."""

import pytest
from commands import read, run_command
from population_study import LEAD, PRELOAD, nozzle_study
from support import quick_nozzle

STUDY = nozzle_study(0.1, "[0, 2e5]", "[sensitivity]\nbase = 16\nlanes = 64\ngradient_points = 3\nreplicates = 20\n")


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    """What the command says of each output, by quantity."""
    folder = tmp_path_factory.mktemp("sensitivity")
    (folder / "study.toml").write_text(STUDY)
    with quick_nozzle():
        outcome = run_command("sensitivity", folder / "study.toml", "--out", folder / "out")
    assert (outcome.status, outcome.err) == (0, "")
    summary = read(folder / "out" / "summary.json")
    assert summary["failed"]["count"] == 0
    return {name: {row["quantity"]: row for row in output["quantities"]} for name, output in summary["outputs"].items()}


def test_what_the_vanes_feel_is_the_nozzles(outputs):
    """The force of this table is in proportion to the lead of the vanes; a preload shifts it by nothing."""
    effects = [name for name in outputs if "vane_effect_2000mbar" in name]
    assert len(effects) == 6
    for name in effects:
        lead, preload = outputs[name][LEAD], outputs[name][PRELOAD]
        assert lead["gradient"] > 0.999
        assert lead["total"]["low"] > 0.5
        assert abs(preload["total"]["value"]) < 1e-3


def test_without_exhaust_gas_a_nozzle_is_not_felt(outputs):
    """Below the outlet's pressure no force acts, whatever the nozzle."""
    cold = [name for name in outputs if "_0mbar" in name]
    assert cold
    for name in cold:
        assert outputs[name][LEAD]["total"]["value"] == pytest.approx(0.0, abs=1e-9)
