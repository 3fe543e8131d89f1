"""Profiles, slices that are no parabolas, and intervals with open ends, as files and reports have them."""

import dataclasses

import numpy as np
import pytest
from commands import entries_of, read, run_command

from calibrate.fit.around import slices_figure, summarise
from calibrate.study.parameter_file import calibrated
from vgtjax.estimation import Around, Profile, Profiles, Slice, Slices


def test_profiles_of_all_are_there_and_shorten_no_interval(small, parameters, summary):
    assert summary["profiles"] == {}  # no direction is flagged
    small.write_text(small.read_text().replace("[fit]", '[fit]\nprofiles = "all"'))
    out = small.parent / "out"
    assert run_command("fit", small, "--out", out).status == 0
    profiles, found = read(out / "summary.json")["profiles"], entries_of(read(out / "parameters.json")["parameters"])
    free = {entry for entry, fields in found.items() if fields["free"]}
    assert set(profiles) >= free
    for entry in free:
        assert profiles[entry]["verdict"].startswith("bounded on both sides")
        linear = entries_of(parameters)[entry]
        assert found[entry]["std_error"] == pytest.approx(linear["std_error"], rel=1e-9)
        assert found[entry]["interval"][0] <= linear["interval"][0] * (1 + 1e-9)
        assert found[entry]["interval"][1] >= linear["interval"][1] * (1 - 1e-9)
    assert "Profile likelihoods" in (out / "report.html").read_text()


def test_what_is_flagged_gets_a_profile_and_its_rows(small, monkeypatch):
    monkeypatch.setattr("vgtjax.estimation.diagnostics._slices.HONEST", 1.0)  # then nothing is a parabola
    outcome = run_command("fit", small, "--out", small.parent / "out")
    summary, page = read(small.parent / "out/summary.json"), (small.parent / "out/report.html").read_text()
    assert outcome.status == 0
    assert "found: the misfit is no parabola along " in outcome.out
    bent = [each for each in summary["slices"] if each["verdict"] != "parabola"]
    assert all(each["reaches"] == [-2, -1, 1, 2] for each in bent)
    for each in bent:
        assert f'<td class="text">{each["verdict"]}: ' in page
    for name, profile in summary["profiles"].items():
        assert f"found: profile of {name}: {profile['verdict']}\n" in outcome.out
        assert f'<code>{name}</code></td><td class="text">{profile["verdict"]}</td>' in page


def test_none_has_none(small, monkeypatch):
    monkeypatch.setattr("vgtjax.estimation.diagnostics._slices.HONEST", 1.0)
    small.write_text(small.read_text().replace("[fit]", '[fit]\nprofiles = "none"'))
    assert run_command("fit", small, "--out", small.parent / "out").status == 0
    assert read(small.parent / "out/summary.json")["profiles"] == {}


@pytest.mark.parametrize(
    ("ends", "limits", "interval"),
    [
        ((-3.0, np.inf), (-np.inf, np.inf), "above"),
        ((-np.inf, 3.0), (-np.inf, np.inf), "below"),
        ((-np.inf, np.inf), (-np.inf, np.inf), "none"),
        ((-np.inf, 3.0), (-2.5, np.inf), "bounded"),
    ],
)
def test_open_ends_are_null(calibration, ends, limits, interval):
    name = "diaphragm.stiffness"
    number = calibration.task.selection.entries.index(name)
    error = float(calibration.uncertainty.std_errors[number])
    profile = Profile(name, error, (-2.0, 0.0, 2.0), (4.0, 0.0, 4.0), ends, limits)
    around = Around(Slices([], 0, 0), Profiles({name: profile}, [], 0))
    (row,) = [row for row in calibrated(calibration, around) if row.name == name]
    value = float(calibration.values[number])
    low, high = value * np.exp(-3 * error), value * np.exp(3 * error)
    expected = {
        "above": (pytest.approx(low), None),
        "below": (0.0, pytest.approx(high)),
        "none": None,
        "bounded": (pytest.approx(value * np.exp(-2.5 * error)), pytest.approx(high)),
    }
    assert row.interval == expected[interval]
    assert row.identifiable == (interval == "bounded")  # a positive value to a factor of ten to either side
    assert row.std_error is not None


@pytest.mark.parametrize(
    ("below", "above", "told"), [(9.9, 9.9, True), (10.1, 9.9, False), (9.9, 10.1, False), (64.0, 66.0, False)]
)
def test_a_profile_beyond_a_factor_of_ten_tells_no_value(calibration, below, above, told):
    """The linear error tells it; where a search has ended elsewhere it does not, and the profile is the same."""
    name = "diaphragm.stiffness"
    number = calibration.task.selection.entries.index(name)
    error = float(calibration.uncertainty.std_errors[number])
    assert calibration.determined[number]
    ends = (-np.log(below) / error, np.log(above) / error)
    profile = Profile(name, error, (-2.0, 0.0, 2.0), (4.0, 0.0, 4.0), ends, (-np.inf, np.inf))
    around = Around(Slices([], 0, 0), Profiles({name: profile}, [], 0))
    (row,) = [row for row in calibrated(calibration, around) if row.name == name]
    value = float(calibration.values[number])
    assert row.interval == (pytest.approx(value / below), pytest.approx(value * above))
    assert row.identifiable == told


@pytest.fixture
def kinked():
    return Slice(
        1, {"a": 0.9, "b": -0.6, "c": 0.01}, (-2.0, -1.0, 1.0, 2.0), (8.0, 3.0, 3.0, 8.0), (2.0, 3.0, 3.0, 2.0)
    )


def test_what_is_no_parabola_is_named(kinked):
    same = dataclasses.replace(kinked, direction=0, reaches=(-2.0, 2.0), values=(4.0, 4.0), bent=(1.0, 1.0))
    slices = Slices([same, kinked], 0, 6)
    around = Around(slices, Profiles({}, ["b"], 0))
    assert around.sentences == [
        "the misfit is no parabola along 1 of 2 directions (1 kinked); the least determined of these is carried by "
        "a, b",
        "1 more carry such directions, and have no profile",
    ]
    assert [each["verdict"] for each in summarise(around)["slices"]] == ["parabola", "kinked"]
    assert summarise(around)["slices"][1]["loadings"] == {"a": 0.9, "b": -0.6}
    assert [trace.name for trace in slices_figure(slices).data] == ["parabola", "parabolas", "1: a, kinked"]
