"""What a study knows of values beforehand."""

import numpy as np
import pytest
from commands import NOTHING_ELSE, read, run_command

import vgtjax
from calibrate.fit.plan import plan
from calibrate.study.base import ParameterValue
from calibrate.study.models import known_beforehand, scales_of
from calibrate.study.units import prepare


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


def test_what_is_said_of_an_entry_counts_wherever_it_stands():
    """The line of its vector, where it came later, made a prior of 20 % one of 1 % without a word."""
    name, model = "converter.magnetic_force", vgtjax.Actuator()
    stated = {
        f"{name}[2]": ParameterValue(relative=0.2, scale="linear"),
        f"{name}[3]": ParameterValue(value=-3e-5),
        name: ParameterValue(relative=0.01, scale="log"),
    }
    values = np.asarray(vgtjax.get_parameter(model, name))
    for given in (stated, dict(reversed(stated.items()))):
        known = known_beforehand(model, given)
        assert known.deviations[f"{name}[2]"] == pytest.approx(0.2 * values[2])
        assert known.deviations[f"{name}[1]"] == pytest.approx(0.01 * values[1])
        assert known.centers[f"{name}[3]"] == -3e-5
        assert known.deviations[f"{name}[3]"] == pytest.approx(3e-7)
        assert [scales_of(model, given)[f"{name}[{k}]"] for k in (1, 2)] == ["log", "linear"]


def test_a_scale_of_the_study_is_that_of_the_fit(small):
    small.write_text(small.read_text() + '"friction.viscous_damping" = {scale = "linear"}\n')
    task = plan(job := prepare(small, None), job.units[0])
    logarithms = dict(zip(task.selection.entries, task.transform().positive, strict=True))
    assert [entry for entry, each in logarithms.items() if each] == [
        "diaphragm.stiffness"
    ]  # and the force may be negative


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
        ('"diaphragm.mass" = {scale = "cubic"}', "scale must be one of log, linear, but it is 'cubic'"),
        ('"diaphragm.preload" = {value = -5.0, scale = "log"}', "change it, or its scale to linear"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(small, line, sentence):
    outcome, out = fitted_with(small, line)
    assert outcome.status == 2
    assert sentence in outcome.err
    assert outcome.err.count("\n") == 1
    assert not out.exists()


SENSOR = f'{NOTHING_ELSE}gain = ["x_d"]\n[[report.sensor]]\nchannel = "x_d"\nrelative_uncertainty = 0.01\n'


def test_a_gain_that_is_free_is_no_parameter_of_the_actuator(small, parameters):
    """It is a nuisance, known beforehand to 1 %. Here it also takes up what held values are off by."""
    small.write_text(small.read_text() + SENSOR)
    outcome = run_command("fit", small, "--out", small.parent / "out")
    assert (outcome.status, outcome.err) == (0, "")
    said, found = (read(small.parent / "out" / name) for name in ("summary.json", "parameters.json"))
    gain = said["instruments"]["gain.x_d"]
    assert 0 < gain["std_error"] < 0.01
    assert abs(gain["value"] - 1.0) < 0.1
    assert found["nuisance"]["step_80"]["gain"] == {"x_d": gain["value"]}
    assert set(found["parameters"]) == set(parameters)
    assert "found: the gain of the sensor of x_d is" in outcome.out
    # The gain's own error is in that of the noise; it is not counted twice.
    assert said["budget"]["diaphragm.stiffness"]["type_b"] == {}


def test_a_sensor_that_can_not_be_free_is_refused(small):
    small.write_text(small.read_text() + '\n[fit.unknown]\noffset = ["f_drive"]\n')
    outcome = run_command("fit", small, "--out", small.parent / "out")
    assert outcome.status == 2
    assert outcome.err == (
        f"error: {small.name}: the offset of a sensor that may be free is that of one of p_res, p_trb with this model, "
        "but it is 'f_drive'; drop it (see [fit.unknown] in the study)\n"
    )
    assert not (small.parent / "out").exists()
