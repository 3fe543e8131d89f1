"""A file of gains gives the controller that was tuned, or is refused in a sentence that names it."""

import json
import pathlib
import re
from types import SimpleNamespace
from typing import Any, get_args

import jax
import numpy as np
import pytest

import vgtjax
from calibrate.study.control import Design
from calibrate.study.parameter_file import tabulate
from calibrate.study.tables import AnyStudy
from calibrate.tune.designs import DESIGNS
from calibrate.tune.gains_file import gains_json, load_controller
from calibrate.tune.job import start_controller
from calibrate.tune.outcome import gain_entries
from vgtjax.tuning import gain_names

FORCE = "base.converter.magnetic_force"


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    """Of a PI, as `tune` writes it."""
    study, plant = AnyStudy.validate_python({"control": {"design": "pi"}}), vgtjax.Actuator()
    controller, _ = start_controller(study.control, plant)
    return gains_json(study, tabulate(controller, controller, {}, {}, gain_names(controller)), plant)


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


def test_of_a_vector_that_is_stated_by_entry_the_file_has_all(tmp_path):
    gains = {f"{FORCE}[1]": {"value": 0.003}}
    study, plant = AnyStudy.validate_python({"control": {"design": "pi", "gains": gains}}), vgtjax.Actuator()
    controller, _ = start_controller(study.control, plant)
    nothing = SimpleNamespace(
        entries=(),
        values=lambda _: np.zeros(0),
        moves_errors=lambda coordinates: np.zeros(0, bool),
    )
    true = SimpleNamespace(
        controller=controller,
        controller_at=lambda _: controller,
        at_bound=lambda coordinates: np.zeros(0, bool),
        selection=nothing,
    )
    job: Any = SimpleNamespace(true=true, smooth=nothing, study=study, bounds={})
    path = write(tmp_path, gains_json(study, gain_entries(job, np.zeros(0)), plant))
    loaded = vgtjax.get_parameter(load_controller(path).controller, FORCE)
    np.testing.assert_array_equal(loaded, vgtjax.get_parameter(controller, FORCE))
    assert float(loaded[1]) == 0.003


@pytest.mark.parametrize(
    ("gains", "sentence"),
    [
        ({FORCE: {"value": [0.003]}}, f"'{FORCE}' needs 5 numbers under value, but it has 1; give a list of 5"),
        (
            {"proportional_gain": {"value": [1.0, 2.0]}},
            "'proportional_gain' needs one number under value, but it has a list; give one number",
        ),
        ({"integral_gan": {"value": 1.0}}, "gain 'integral_gan' matches nothing; did you mean 'integral_gain'?"),
        ({"integral_gain": {"value": -1.0}}, "'integral_gain' must be finite and not negative, but it is -1; correct"),
    ],
)
def test_gains_that_are_not_the_designs_are_refused_with_the_name_of_their_file(gains, sentence, content, tmp_path):
    path = write(tmp_path, content | {"parameters": gains})
    with pytest.raises(vgtjax.InputError, match="^" + re.escape(f"gains.json: {sentence}")):
        load_controller(path)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"model": "mechanical"}, "its plant must be of model = 'full', but it is 'mechanical'; tune again"),
        ({"design": "backstepping", "friction": "coulomb"}, "a plant must have LuGre friction"),
    ],
)
def test_a_plant_that_the_design_has_no_use_for_is_refused_with_the_name_of_the_file(
    changes, sentence, content, tmp_path
):
    components = content["components"] | {"friction": changes.get("friction", "lugre")}
    path = write(tmp_path, content | changes | {"components": components, "plant": {}})
    with pytest.raises(vgtjax.InputError, match="^" + re.escape(f"gains.json: {sentence}")):
        load_controller(path)


def test_every_design_that_a_study_may_name_has_a_controller():
    assert list(DESIGNS) == list(get_args(Design))
