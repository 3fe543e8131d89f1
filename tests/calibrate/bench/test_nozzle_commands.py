"""The commands `fit` and `check` on a study of loops with a nozzle free, as the benchmark writes it; its tables take no
flows."""

import pathlib

import pytest
from commands import Outcome, read, run_command
from support import quick_nozzle

from calibrate.bench.nozzle_loops import TRUE as EVERY_TRUE, record, write_study
from vgtjax.assurance import UNEQUAL

LEAD, FRICTION, UNFELT = "vane_force.nozzle.lead", "friction.coulomb_force", "vane_force.nozzle.trail"
TRUE = {name: EVERY_TRUE[name] for name in (LEAD, FRICTION)}


@pytest.fixture(scope="module")
def ran(tmp_path_factory) -> tuple[dict[str, Outcome], pathlib.Path]:
    """One short loop. The force of such a table is in proportion to the lead, and the trail changes nothing."""
    folder = tmp_path_factory.mktemp("nozzle")
    with quick_nozzle():
        study = write_study(folder, record(TRUE, gauge=[2e5], length=2.0), [*TRUE, UNFELT])
        return {name: run_command(name, study, "--out", folder / name) for name in ("fit", "check")}, folder


def test_fit_finds_the_nozzle_again(ran):
    outcomes, folder = ran
    assert (outcomes["fit"].status, outcomes["fit"].err) == (0, "")
    found = read(folder / "fit" / "parameters.json")["parameters"]
    for entry, true in TRUE.items():
        value, error = found[entry]["value"], found[entry]["std_error"]
        # Four standard errors: one of 16 000 values is further off; each is known to a tenth of itself.
        assert abs(value - true) < 4 * error < 0.4 * true
    assert not found[UNFELT]["identifiable"]


def test_its_derivatives_are_certified_in_reverse_mode_too(ran):
    """Of parameters that act through a table alone, and of one that does not."""
    said = read(ran[1] / "fit" / "summary.json")["certificate"]
    assert said["passed"]
    assert said["dead_columns"] == [UNFELT]
    assert 0 < max(said["forward_against_reverse"]) < UNEQUAL


def test_both_say_what_is_assumed_and_check_what_no_loop_feels(ran):
    outcomes, folder = ran
    assert outcomes["check"].status == 0
    told = read(folder / "check" / "summary.json")
    assert told["null"] == [[UNFELT]]
    assert any(f"no trace depends on {UNFELT}" in sentence for sentence in told["sentences"])
    for said in (told["sentences"], read(folder / "fit" / "summary.json")["found"]):
        assert any("assumed values of the turbine for exact" in sentence for sentence in said)
