"""What is said of the fitted units that gains are tuned on and tried on."""

import json
import pathlib
import shutil

import pytest
from support import EXAMPLE

from calibrate.control.job import prepare_control
from calibrate.tune.job import prepare_tuning

UNITS = EXAMPLE / "fleet" / "units"
STUDY = """[components]
vane_force = "speed-map"
[control]
design = "pi"
duration = 0.5
settled = 0.1
period = 2e-3
plants = {plants}
[[control.reference]]
kind = "sine"
amplitude = 0.001
rate = 12.0
offset = 0.005
[control.unseen]
plants = {unseen}
"""


@pytest.fixture(scope="module")
def units(tmp_path_factory) -> pathlib.Path:
    """Three fits, the second of which did not converge."""
    folder = tmp_path_factory.mktemp("units")
    for name in ("unit_01", "unit_02", "unit_03"):
        (folder / name).mkdir()
        shutil.copy(UNITS / name / "parameters.json", folder / name)
    (folder / "unit_02" / "summary.json").write_text(json.dumps({"converged": False}))
    return folder


def write(folder: pathlib.Path, plants: int, unseen: int) -> pathlib.Path:
    (folder / "study.toml").write_text(STUDY.format(plants=plants, unseen=unseen))
    return folder / "study.toml"


def test_a_fit_that_did_not_converge_is_named_in_tune_as_in_control(units, tmp_path):
    study = write(tmp_path, 2, 1)
    for notes in (prepare_tuning(study, units).notes, prepare_control(study, units, None).notes):
        assert "the fits of unit_02 have not converged, but count like the others" in notes


@pytest.mark.parametrize(
    ("plants", "unseen", "note"),
    [
        (3, 1, "gains are tuned on all units, so they are tried on the same ones"),
        (2, 0, "control.unseen.plants is 0, so gains are tried on the units that they are tuned on"),
    ],
)
def test_it_is_said_why_gains_are_tried_on_what_they_are_tuned_on(plants, unseen, note, units, tmp_path):
    job = prepare_tuning(write(tmp_path, plants, unseen), units)
    assert [each for each in job.notes if each.startswith(("gains", "control"))] == [note]
    assert {label.plant for label in job.unseen.cases.labels} == {label.plant for label in job.true.cases.labels}
