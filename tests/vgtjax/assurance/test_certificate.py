"""Derivatives against differences: a fit as it is passes, each spoilt column is found by its name."""

import dataclasses

import numpy as np
import pytest
from known_truth import FREE, TRUTH, bench

import vgtjax
from vgtjax.assurance import UNEQUAL, certifying
from vgtjax.estimation import LevenbergMarquardt, Slopes, plan_task, run_alone, start_calibration


@pytest.fixture(scope="module")
def ended():
    return run_alone(start_calibration(plan_task(vgtjax.Actuator(), [bench(0)], free=FREE)).ending())


def spoilt(ended, entry, factor):
    """Derivatives by an entry that are not what a simulation shows."""
    search, number = ended.minimiser, ended.task.selection.entries.index(entry)
    evaluated = search.slopes.evaluated
    columns = [each * np.where(np.arange(each.shape[-1]) == number, factor, 1.0) for each in evaluated.columns]
    slopes = dataclasses.replace(search.slopes, evaluated=dataclasses.replace(evaluated, columns=columns))
    return dataclasses.replace(
        ended, minimiser=LevenbergMarquardt(search.problem, search.progress, slopes, search.point)
    )


def spoilt_later(ended, entry, factor):
    """The same of the linear problem that errors rest on, which is made of derivatives."""
    search, columns = ended.minimiser, np.array(ended.minimiser.point.columns)
    columns[:, ended.task.selection.entries.index(entry)] *= factor
    point = dataclasses.replace(search.point, columns=columns)
    return dataclasses.replace(
        ended, minimiser=LevenbergMarquardt(search.problem, search.progress, search.slopes, point)
    )


def test_exact_derivatives_pass(ended):
    found = run_alone(certifying(ended))
    assert found.passed
    assert max(found.mismatches) < 0.005
    assert (found.dead, found.exploded, found.wrong, found.unequal) == ([], [], {}, {})
    assert max(found.modes) < 1e-10  # rounding; measured: 1e-13
    assert len(found.modes) == len(found.mismatches)
    assert found.repeated == UNEQUAL
    assert found.sentence.startswith("derivatives agree with differences")
    assert found.summary()["passed"] is True


@pytest.mark.parametrize("entry", FREE)
@pytest.mark.parametrize(("factor", "part"), [(2.0, 0.5), (0.0, 1.0), (np.nan, None)])
@pytest.mark.parametrize("spoil", [spoilt, spoilt_later])
def test_a_spoilt_column_fails_by_its_name(ended, spoil, entry, factor, part):
    found = run_alone(certifying(spoil(ended, entry, factor)))
    assert not found.passed
    assert entry in found.sentence
    if part is None:
        assert found.exploded == [entry]
    else:
        assert found.wrong == {entry: pytest.approx(part, abs=0.01)}
        assert set(found.unequal) == {entry}
    assert found.summary()["passed"] is False


def test_a_small_mistake_shows_in_reverse_mode_alone(ended):
    """A thousandth of a column is far below what differences tell."""
    found = run_alone(certifying(spoilt(ended, "chamber.volume", 1.001)))
    assert found.wrong == {}
    assert found.unequal == {
        "chamber.volume": pytest.approx(1e-3, rel=0.9)
    }  # times the cosine between it and what is pulled back
    assert found.sentence.startswith(
        "the gradient certificate failed: the derivative with respect to chamber.volume differs from reverse mode"
    )
    assert found.summary()["unequal_columns"] == found.unequal


def shaken(part):
    """Derivatives in forward mode that are off by about a part, elsewhere at each place."""
    generator, find = np.random.default_rng(0), Slopes.find

    def found(*asked):
        slopes = yield from find(*asked)
        columns = [each * (1 + part * generator.standard_normal(each.shape[-1])) for each in slopes.columns]
        return dataclasses.replace(slopes, columns=columns)

    return staticmethod(found)


def test_modes_need_not_agree_better_than_forward_mode_with_itself(ended, monkeypatch):
    """Of rods that stick and slip for long: a rounding more gives other derivatives. A hundredth is never excused."""
    monkeypatch.setattr(Slopes, "find", shaken(1e-4))
    found = run_alone(certifying(spoilt(ended, "chamber.volume", 1.001)))
    assert found.passed
    assert UNEQUAL < max(found.modes) < found.repeated < 0.01
    found = run_alone(certifying(spoilt(ended, "chamber.volume", 1.05)))
    assert set(found.unequal) == {"chamber.volume"}
    monkeypatch.setattr(Slopes, "find", shaken(np.nan))
    assert not run_alone(certifying(spoilt(ended, "chamber.volume", 1.001))).passed


def test_many_derivatives_that_differ_are_counted(ended):
    found = run_alone(certifying(ended))
    several = dataclasses.replace(found, unequal={f"p[{number}]": 1e-3 * number for number in range(1, 8)})
    assert several.sentence.endswith("failed: 7 derivatives differ from reverse mode, by up to 0.7 %")


def test_what_could_not_be_checked_is_not_passed(ended, monkeypatch):
    def fails(*_):
        return None
        yield

    monkeypatch.setattr("vgtjax.assurance._certificate.misfit_at", fails)
    found = run_alone(certifying(ended))
    assert found.uncompared == ["differences"]
    assert set(found.unchecked) == set(FREE)  # each was asked by itself as well
    assert not found.passed
    assert found.sentence == (
        "the gradient certificate failed: derivatives could not be compared with differences, as simulations failed"
    )
    assert found.summary()["forward_against_differences"] == [None] * len(found.mismatches)


def test_a_kink_along_all_is_no_wrong_derivative(ended):
    """Directions that miss a difference, and columns that do not by themselves."""
    found = dataclasses.replace(run_alone(certifying(ended)), mismatches=[0.99, np.nan], alone={"a": 0.1, "b": 0.0})
    assert found.passed
    assert "to one parameter agree with differences to 10 %, along random directions to 99 %" in found.sentence
    assert dataclasses.replace(found, alone={"a": 0.4}).wrong == {"a": 0.4}
    lost = dataclasses.replace(found, alone={"a": 0.1, "b": np.nan})
    assert not lost.passed
    assert lost.sentence.endswith(
        "the derivative with respect to b could not be compared with differences, as simulations failed"
    )
    assert not dataclasses.replace(found, alone={}).passed


def test_what_changes_nothing_is_dead_but_not_wrong():
    """The rod does not reach its open stop."""
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=["chamber.volume", "diaphragm.travel"])
    found = run_alone(certifying(run_alone(start_calibration(task).ending())))
    assert found.passed
    assert found.dead == ["diaphragm.travel"]


def test_what_changes_something_to_one_side_alone_is_a_bound():
    """The rod turns round so near its end stop that the travel may be larger, but not smaller."""
    model = vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH)
    reached = float(np.max(vgtjax.simulate(model, bench(0)).x_d))
    model = vgtjax.replace_parameters(model, {"diaphragm.travel": reached + 2e-6})
    task = plan_task(model, [bench(0)], free=["chamber.volume", "diaphragm.preload", "diaphragm.travel"])
    ended = run_alone(start_calibration(task).ending())
    found = run_alone(certifying(ended))
    assert found.passed
    assert found.bounding == {"diaphragm.travel": "least"}
    assert found.remarks == ["the value of diaphragm.travel is a bound: a larger value would change nothing"]
    wrong = run_alone(certifying(spoilt(ended, "chamber.volume", 0.0)))
    assert set(wrong.wrong) == {"chamber.volume"}
