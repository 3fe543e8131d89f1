"""What a fit says last in the terminal, of many starts, and of a misfit that is no parabola."""

import dataclasses
import math

import pytest
from commands import entries_of
from pages import Page

from calibrate.fit.around import summarise
from calibrate.fit.outcome import Fitted
from calibrate.fit.report import render, waterfall_figure
from calibrate.study.parameter_file import calibrated
from calibrate.study.units import prepare
from vgtjax.assurance import Certificate
from vgtjax.estimation import Around, found_besides
from vgtjax.estimation._found import starts_sentence
from vgtjax.estimation.diagnostics._profiles import Profiles
from vgtjax.estimation.diagnostics._slices import Slice, Slices


@pytest.fixture(scope="module")
def rows(fitted):
    """Lines of the tables by what stands first in them."""
    said = [line.split() for line in fitted.outcome.out.partition("RMSE of x_d")[2].splitlines()]
    return {line[0]: line[1:] for line in said if line}


def test_each_trace_has_its_rmse_beside_its_noise(rows, summary):
    for name, trace in summary["traces"].items():
        use, *numbers = rows[name]
        pairs = zip(trace["rmse"].values(), trace["noise"].values(), strict=True)
        assert use == trace["use"]
        assert numbers == [f"{value:.3g}" for pair in pairs for value in pair]


def test_each_free_parameter_has_its_value_error_and_interval(rows, parameters):
    free = {name: row for name, row in entries_of(parameters).items() if row["free"]}
    assert free
    for name, row in free.items():
        low, high = row["interval"]
        numbers = [f"{row['value']:.6g}", f"{row['std_error']:.2g}", f"{low:.5g}", "to", f"{high:.5g}"]
        assert rows[name][:5] == numbers
        assert ("determined" in rows[name]) == (not row["identifiable"])
    held = set(entries_of(parameters)) - set(free)
    assert not held & set(rows)


def test_one_sentence_ends_it(fitted, summary):
    *_, verdict, report = fitted.outcome.out.replace("\n", " ").partition("verdict: ")[2].partition("report: ")
    assert verdict
    assert fitted.outcome.out.replace("\n", " ").count(f"verdict: {summary['sentence']}") == 1
    assert report


def test_many_starts_are_counted_and_shown(calibration):
    """Those within one of chi^2 of the least are the same optimum; one that failed is named."""
    chi2 = 1.0 / (2 * calibration.count)
    waterfall = ((3.0, 5, "converged"), (3.0 + 0.9 * chi2, 4, "joined"), (3.0 + 1.1 * chi2, 6, "converged"))
    waterfall += ((40.0, 3, "hopeless"), (None, 0, "failed: step_80 diverged"))
    progress = dataclasses.replace(calibration.progress, waterfall=waterfall)
    assert starts_sentence(dataclasses.replace(calibration, progress=progress)) == (
        "2 of 5 starts end at the same optimum (2 converged, 1 joined, 1 hopeless, 1 failed); start 4 failed: step_80 "
        "diverged"
    )
    shown = {curve.name: (list(curve.x), list(curve.y)) for curve in waterfall_figure(progress.ends).data}
    assert set(shown) == {"converged", "joined", "hopeless"}
    assert shown["hopeless"] == ([4], [80.0])
    assert shown["converged"][0] == [1, 3]


def test_a_search_that_went_on_with_shorter_steps_says_so(calibration):
    said = "derivatives failed with longer steps along slow traces; the search went on with shorter ones"
    refined = dataclasses.replace(calibration.progress, finer=True)
    assert said not in found_besides(calibration)
    assert said in found_besides(dataclasses.replace(calibration, progress=refined))


def test_a_hold_that_slow_traces_cannot_tell_is_said(calibration):
    said = next(each for each in _with(calibration, otherwise=(0.0,)) if "cannot tell" in each)
    assert "state duty_hold of the traces if it is known" in said
    assert said not in _with(calibration, otherwise=())
    assert said not in found_besides(calibration)


def _with(calibration, **changes):
    """What is said of a fit whose progress is another."""
    progress = dataclasses.replace(calibration.progress, **changes)
    return found_besides(dataclasses.replace(calibration, progress=progress))


def test_a_misfit_that_is_no_parabola_is_shown_with_the_numbers_of_the_summary(fitted, calibration):
    name = "diaphragm.stiffness"
    bent = Slice(2, {name: 1.0}, (-2.0, -1.0, 1.0, 2.0), (8.125, 3.0625, 3.25, math.inf), (2.0, 3.0, 3.0, 2.0))
    around = Around(Slices([bent], 0, 4), Profiles({}, [], 0))
    passed = Certificate([0.0], [0.0], 0.0, {}, [], {}, [], {})
    before = {"sentences": [], "undetermined": [], "expected_relative_error": {name: 0.0125}, "next": []}
    job = prepare(fitted.study, None, to_fit=True)
    found = Fitted(calibration, passed, around, None, 1.0, before)
    page = Page(render(job, job.units[0], found, calibrated(calibration, around)))
    (row,) = page.table("direction", "carried by")
    (written,) = summarise(around)["slices"]
    rises = [
        f"{reach:+.0f}: {value:.3g}" for reach, value in zip(written["reaches"][:3], written["values"], strict=False)
    ]
    assert row["direction"] == "2"
    assert row["carried by"] == name
    assert row["rise at standard errors"] == ", ".join([*rises, "+2: fails"])
    assert written["values"][3] is None  # a simulation that failed
