"""What a study knows of values beforehand."""

import numpy as np
import pytest
from commands import read, run_command


def fitted_with(study, line):
    text = study.read_text()
    study.write_text(text + line + "\n" if "[parameters]" in text else text + "\n[parameters]\n" + line + "\n")
    out = study.parent / "out"
    return run_command("fit", study, "--out", out), out


def test_the_tolerance_of_a_held_parameter_widens_every_error(small, parameters):
    outcome, out = fitted_with(small, '"diaphragm.area" = {relative = 0.01}')
    assert (outcome.status, outcome.err) == (0, "")
    found = read(out / "parameters.json")["parameters"]
    assert found["diaphragm.area"]["free"] is False
    free = [name for name, fields in found.items() if fields["free"] is True]
    wider = [found[name]["std_error"] / parameters[name]["std_error"] for name in free]
    assert np.min(wider) > 0.99
    assert np.max(wider) > 3  # the stiffness, which the area multiplies


def test_a_prior_is_part_of_the_misfit_around_the_end(small, parameters):
    """So that slices don't begin below the end, and profiles can be computed."""
    before = parameters["diaphragm.preload"]
    deviation = 5 * before["std_error"]
    small.write_text(small.read_text().replace("[fit]\n", '[fit]\nprofiles = "all"\n'))
    outcome, out = fitted_with(small, f'"diaphragm.preload" = {{value = {before["value"]}, deviation = {deviation}}}')
    assert (outcome.status, outcome.err) == (0, "")
    said = read(out / "summary.json")
    assert said["profiles"]
    assert all(each["verdict"] != "downhill" for each in said["slices"])


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('"diaphragm.mass" = {deviation = 0.1, relative = 0.1}', "there are both; drop one"),
        ('"diaphragm.mass" = {deviation = -0.1}', "greater than 0"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(small, line, sentence):
    outcome, out = fitted_with(small, line)
    assert outcome.status == 2
    assert sentence in outcome.err
    assert outcome.err.count("\n") == 1
    assert not out.exists()
