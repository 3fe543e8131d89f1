"""The command `identify` on a rod with a turbine, whose table takes no flows here."""

import shutil
from unittest import mock

import pytest
from commands import read, run_command
from support import EXAMPLE, quick_nozzle

from vgtjax.identification import _pipeline

STUDY = """model = "mechanical"
[components]
vane_force = "turbine"
[[trace]]
file = "unit_01_*.csv"
"""


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The folder of a study of two loops, without exhaust gas and with it, and what the user saw. Tests of friction,
    which read the first alone, are left out: one of them is a fit."""
    folder = tmp_path_factory.mktemp("identify")
    for pressure in ("0000", "1500"):
        shutil.copy(EXAMPLE / "loops" / f"unit_01_{pressure}mbar.csv", folder)
    (folder / "study.toml").write_text(STUDY)
    with quick_nozzle(), mock.patch.object(_pipeline, "MECHANICAL", ()):
        return folder / "out", run_command("identify", folder / "study.toml", "--out", folder / "out")


def test_what_needs_no_exhaust_gas_is_identified(identified):
    out, outcome = identified
    assert (outcome.status, outcome.err) == (0, "")
    found = read(out / "parameters.json")["parameters"]
    free = {name for name, row in found.items() if row["free"] is True}
    assert free == {"diaphragm.preload", "diaphragm.stiffness", "diaphragm.travel"}
    # Of this unit a fit finds the stiffness from all its loops: the spring's test is within 1 %.
    assert 10_500 < found["diaphragm.stiffness"]["value"] < 12_500
    assert not any(row["free"] for name, row in found.items() if name.startswith("vane_force."))


def test_of_the_nozzle_it_says_what_tells(identified):
    sentence = (
        "vane force map [3.16]: not possible: the model's vane force follows from a nozzle, of which no test alone "
        "tells; free e.g. vane_force.nozzle.lead in a fit"
    )
    assert sentence in identified[1].out
    sections = {section["name"]: section for section in read(identified[0] / "summary.json")["sections"]}
    assert not sections["vane force map"]["values"]


def test_both_loops_are_simulated_with_the_turbine(identified):
    """Its some 5 N over a stiffness of 12 N/mm move the loop under exhaust gas by a third of a millimetre from where it
    is in this unit, whose force changes its sign with the direction; without gas nothing moves."""
    traces = read(identified[0] / "summary.json")["traces"]
    cold, hot = (abs(traces[f"unit_01_{pressure}mbar"]["offset"]["x_d"]) for pressure in ("0000", "1500"))
    assert cold < 2e-5
    assert 2e-4 < hot < 6e-4
