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
