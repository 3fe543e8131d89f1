"""A file of gains gives the controller that was tuned, or is refused in a sentence that names it."""

import json
import pathlib

import jax
import numpy as np
import pytest

import vgtjax
from calibrate.study.parameter_file import tabulate
from calibrate.study.tables import AnyStudy
from calibrate.tune.gains_file import gains_json, load_controller
from calibrate.tune.job import start_controller
from vgtjax.tuning import gain_names


def write(folder: pathlib.Path, content: dict) -> pathlib.Path:
    path = folder / "gains.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "components",
    [{"vane_force": "polynomial"}, {"friction": "dahl"}, {"magnetic_force": "coil"}],
    ids=lambda given: next(iter(given.values())),
)
def test_a_controller_of_the_printed_actuator_comes_back_without_the_studys_components(components, tmp_path):
    control = {"design": "backstepping", "belief": "printed"}
    study, printed = AnyStudy.validate_python({"components": components, "control": control}), vgtjax.Actuator()
    tuned, _ = start_controller(study.control, printed)
    content = gains_json(study, tabulate(tuned, tuned, {}, {}, gain_names(tuned)), printed)
    loaded = load_controller(write(tmp_path, content)).controller
    assert jax.tree.structure(loaded) == jax.tree.structure(tuned)
    for mine, read in zip(jax.tree.leaves(tuned), jax.tree.leaves(loaded), strict=True):
        np.testing.assert_array_equal(mine, read)
