"""Parameters or a folder that a command can't take end it before it writes anything, in one sentence."""

import json

import pytest
from commands import Outcome, assert_refused, run_command

COMPONENTS = {
    "friction": "lugre",
    "vane_force": "none",
    "line": "none",
    "magnetic_force": "static",
    "chamber": "adiabatic",
}


def given(name: str, value: object) -> dict[str, object]:
    return {"model": "full", "components": COMPONENTS, "parameters": {name: {"value": value}}}


SAME_MODEL = "but the study's is 'full'; give parameters of the same model"
NO_FIT = "this is no parameters.json of a fit; give one that 'fit' wrote"
PARAMETER_FILES = [
    (
        {"model": "mechanical", "parameters": {}},
        f"these are parameters of the model 'mechanical', {SAME_MODEL}",
    ),
    ({"schema": 2, "parameters": {}}, f"these are parameters of the model 'None', {SAME_MODEL}"),
    ({"parameters": {}}, f"these are parameters of the model 'None', {SAME_MODEL}"),
    (
        {"model": "full", "components": {**COMPONENTS, "friction": "dahl"}, "parameters": {}},
        "these are parameters of a model with other components than the study's; give parameters of the same "
        "components",
    ),
    ([1, 2], NO_FIT),
    ({"model": "full"}, NO_FIT),
    ({"model": "full", "parameters": {"chamber.volume": 1}}, "the parameter 'chamber.volume' has no value; add it"),
    (given("chamber.volum", 1), "parameter 'chamber.volum' matches nothing; did you mean 'chamber.volume'?"),
    (given("chamber.volume", "6e-5"), "the value of 'chamber.volume' must be a number, but it is '6e-5'; correct it"),
    (given("chamber.volume", True), "the value of 'chamber.volume' must be a number, but it is True; correct it"),
]


@pytest.mark.parametrize(("content", "sentence"), PARAMETER_FILES)
def test_parameters_that_do_not_fit_the_study(folder, fit, content, sentence):
    (folder / "p.json").write_text(json.dumps(content))
    assert_refused(fit("--parameters", folder / "p.json"), f"p.json: {sentence}", folder / "out")


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("chamber.volume", -1, "'chamber.volume' must be finite and not negative, but it is -1; correct it"),
        ("chamber.volume", None, "'chamber.volume' must be finite and not negative, but it is inf; correct it"),
        ("chamber.volume", 10**400, "'chamber.volume' must be finite and not negative, but it is inf; correct it"),
        ("chamber.volume", [6e-5], "'chamber.volume' needs one number under value, but it has a list; give one number"),
        (
            "converter.magnetic_force",
            [1.0],
            "'converter.magnetic_force' needs 5 numbers under value, but it has 1; give a list of 5",
        ),
    ],
)
def test_parameters_that_no_actuator_has(folder, fit, name, value, sentence):
    (folder / "p.json").write_text(json.dumps(given(name, value)))
    assert_refused(fit("--parameters", folder / "p.json"), f"p.json: {sentence}", folder / "out")


def test_parameters_that_are_no_json(folder, fit):
    (folder / "p.json").write_text("{")
    reason = "Expecting property name enclosed in double quotes: line 1 column 2 (char 1)"
    sentence = f"p.json: this is not valid JSON ({reason}); write it again"
    assert_refused(fit("--parameters", folder / "p.json"), sentence, folder / "out")


def test_parameters_that_are_not_there(folder, fit):
    path = folder / "no.json"
    sentence = f"{path}: can't be read (No such file or directory); check the path"
    assert_refused(fit("--parameters", path), sentence, folder / "out")


def test_a_folder_that_has_no_parameters(folder, fit):
    sentence = f"{folder} has no parameters for a study without units; fit that unit first"
    assert_refused(fit("--parameters", folder), sentence, folder / "out")


def test_a_folder_that_has_no_parameters_for_a_unit(folder, fit):
    (folder / "study.toml").write_text('[[trace]]\nfile = "bench.csv"\nunit = "a"\n')
    sentence = f"{folder} has no parameters for a; fit that unit first"
    assert_refused(fit("--parameters", folder), sentence, folder / "out")


def test_out_is_a_file(folder, fit):
    (folder / "out").write_text("mine")
    outcome = fit()
    assert outcome == Outcome(
        2, "", f"error: --out must be a folder, but {folder / 'out'} is a file; choose another name\n"
    )
    assert (folder / "out").read_text() == "mine"


def test_out_lies_below_a_file(folder):
    out = folder / "bench.csv" / "out"
    outcome = run_command("fit", folder / "study.toml", "--out", out)
    assert_refused(outcome, f"{out}: can't be written (Not a directory); choose another --out", out)


def test_out_holds_something_else(folder, fit):
    (folder / "out").mkdir()
    (folder / "out" / "mine").touch()
    outcome = fit()
    assert outcome == Outcome(
        2, "", f"error: {folder / 'out'} is not empty and no study wrote it; choose another --out\n"
    )
    assert [path.name for path in (folder / "out").iterdir()] == ["mine"]


@pytest.mark.parametrize("arguments", [["fit"], ["fit", "--out"], ["simulate", "--outt", "x"], ["fits", "--out", "x"]])
def test_a_command_line_that_is_none(arguments):
    outcome = run_command(*arguments)
    assert outcome.status == 2
    assert outcome.err.splitlines()[-1].startswith("Error: ")
