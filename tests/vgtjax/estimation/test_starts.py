"""A search from many starts: where they lie, that they end at the same place, and what becomes of hopeless ones."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from known_truth import FREE, bench
from support import duty_trace

import vgtjax
from vgtjax.estimation import (
    LevenbergMarquardt,
    Progress,
    calibrate,
    estimate_uncertainty,
    plan_task,
    run_alone,
    start_calibration,
    starting,
)
from vgtjax.estimation.search import _searches, _telling
from vgtjax.estimation.search._beginning import first_progress
from vgtjax.estimation.search._many_starts import _with_all_traces
from vgtjax.estimation.search._point import Reduced
from vgtjax.estimation.search._progress import quiet
from vgtjax.estimation.search._searches import FAR_OFF
from vgtjax.estimation.search._starts import (
    FACTOR,
    STATED,
    Ended,
    _hopeless,
    _Optimum,
    best_of,
    searching_from,
    starts_of,
)
from vgtjax.estimation.search._telling import most_telling


def planned(traces=None, **choices):
    return plan_task(vgtjax.Actuator(), [bench(0)] if traces is None else traces, free=FREE, **choices)


def starts(task, count):
    calibrator = start_calibration(task)
    return starts_of(task, calibrator.transform, count), calibrator.transform


def test_starts_lie_around_the_given_one():
    task = planned()
    found, transform = starts(task, 33)
    values = np.array([np.asarray(transform.to_physical(each)) for each in found])
    given = np.asarray(task.selection.pack(task.model))
    np.testing.assert_allclose(values[0], given, rtol=1e-12)
    assert len(values) == 33
    assert len(np.unique(values[:, 0])) == 33
    positive = np.asarray(transform.positive)
    ratios = values[:, positive] / given[positive]
    assert np.all((ratios > 1 / FACTOR - 1e-9) & (ratios < FACTOR + 1e-9))
    assert ratios.min() < 0.72
    assert ratios.max() > 1.4
    np.testing.assert_array_equal(found, starts(task, 33)[0])  # the same at every run


def test_starts_keep_to_bounds_and_to_what_is_known():
    stiffness = 12_000.0
    choices = {"bounds": {"chamber.volume": (5e-5, 6e-5)}, "deviations": {"diaphragm.stiffness": 0.01 * stiffness}}
    task = planned(**choices)
    found, transform = starts(task, 17)
    values = {
        entry: column
        for entry, column in zip(
            task.selection.entries, np.array([transform.to_physical(each) for each in found]).T, strict=True
        )
    }
    assert values["chamber.volume"].min() >= 5e-5
    assert values["chamber.volume"].max() <= 6e-5 * (1 + 1e-12)
    off = np.log(values["diaphragm.stiffness"] / values["diaphragm.stiffness"][0])
    assert 0.01 < np.max(np.abs(off)) <= STATED * 0.0101


def test_all_starts_end_at_the_same_place_as_one():
    task = planned()
    alone, many = calibrate(task), calibrate(planned(starts=4))
    assert many.converged
    costs, steps, statuses = zip(*many.progress.waterfall, strict=True)
    assert statuses[0] == "converged"
    assert set(statuses) <= {"converged", "joined"}
    assert min(steps) >= 1
    # chi^2 within a hundredth: the search's own tolerance.
    assert 2 * many.count * np.ptp(costs) < 0.02
    np.testing.assert_allclose(many.values, alone.values, atol=0.02 * np.max(alone.std_errors), rtol=1e-4)
    assert alone.progress.waterfall == ()
    # Where others have been before, a start is not followed to its end: here is one that is.
    last = Progress(tuple(starts(task, 4)[0][3].tolist()))
    again = start_calibration(task, last).run()
    np.testing.assert_allclose(again.values, alone.values, atol=0.02 * np.max(alone.std_errors), rtol=1e-4)


def test_an_interrupted_search_does_not_begin_its_starts_again():
    task, seen = planned(starts=3), []
    calibrate(task, seen.append)
    resumed = []
    start_calibration(task, Progress(**dataclasses.asdict(seen[0]))).run(resumed.append)
    assert seen[0].waterfall
    assert [each.coordinates for each in resumed] == [each.coordinates for each in seen[1:]]


@pytest.mark.parametrize(
    ("history", "hopeless"),
    [
        ((100.0, 90.0, 80.0, 70.0), True),
        ((100.0, 90.0, 80.0, 20.0), False),  # still falls
        ((100.0, 4.0, 3.0, 2.5), False),  # near
        ((100.0, 70.0), False),  # hardly begun
    ],
)
def test_what_is_hopeless(history, hopeless):
    progress = Progress((0.0,), history=history, iteration=len(history) - 1)
    assert _hopeless(progress, least=1.0) == hopeless
    assert not _hopeless(progress, least=np.inf)


def test_the_best_end_is_a_converged_one():
    ended = [Ended(1.0, 5, "stuck", (1.0,)), Ended(2.0, 5, "converged", (2.0,)), Ended(3.0, 5, "converged", (3.0,))]
    assert best_of(ended).coordinates == (2.0,)
    with pytest.raises(vgtjax.SimulationError, match="none of 1 starts can be simulated: failed: too far"):
        best_of([Ended(np.inf, 0, "failed: too far")])


def test_a_start_that_cannot_be_simulated_touches_no_other():
    task = planned()
    found, _ = starts(task, 3)
    first = Progress(tuple(found[0].tolist()))

    def begin(progress):
        if progress.coordinates == tuple(found[1].tolist()):
            raise vgtjax.SimulationError("too far")
        return starting(task, progress)

    def as_it_is(progress):
        return progress
        yield

    places = [dataclasses.replace(first, coordinates=tuple(each.tolist())) for each in found]
    ended = run_alone(searching_from(places, begin, as_it_is))
    assert [each.status for each in ended] == ["converged", "failed: too far", "joined"]
    assert ended[1].row == (None, 0, "failed: too far")


def test_many_starts_run_on_traces_that_tell_most_and_end_with_all(monkeypatch):
    still = duty_trace((0, 2.0), p_res=2.0e4)
    resting = still.replace(x_d=0 * still.time, p_act=0 * still.time + still.atmosphere, name="still")
    task = planned(starts=3, traces=[resting, bench(0), bench(1)])
    search = start_calibration(task).minimiser
    whole = {number: len(trace.time) for number, trace in enumerate(task.fit)}
    assert most_telling(task, search) == whole  # they are short
    usual = _telling.COARSER
    monkeypatch.setattr(_telling, "FEW", 0)
    ((chosen, samples),) = most_telling(task, search).items()
    assert chosen in (1, 2)
    assert samples < whole[chosen]
    monkeypatch.setattr(_telling, "COARSER", 1.01)
    assert most_telling(task, search).keys() == {1, 2}
    monkeypatch.setattr(_telling, "COARSER", usual)
    many, alone = calibrate(task), calibrate(dataclasses.replace(task, starts=1))
    np.testing.assert_allclose(many.values, alone.values, atol=0.02 * np.max(alone.std_errors), rtol=1e-4)
    costs = [each.cost for each in many.progress.ends]
    assert 2 * many.count * np.ptp([*costs, alone.progress.searched]) < 0.02  # the search's own tolerance


@pytest.mark.parametrize("coarser", [1.2, 3.0, 10.0])
def test_parts_of_traces_leave_errors_as_large_as_allowed(coarser, monkeypatch):
    """By the errors of a search on these parts alone; their noise, seen on fewer samples, is 5 % off at most."""
    monkeypatch.setattr(_telling, "FEW", 0)
    monkeypatch.setattr(_telling, "COARSER", coarser)
    task = planned(traces=[bench(0), bench(1)])
    search = start_calibration(task).minimiser
    part = start_calibration(task.of_parts(most_telling(task, search))).minimiser
    larger = part.uncertainty().std_errors / search.uncertainty().std_errors
    assert np.max(larger) < 1.05 * coarser


def test_an_end_on_parts_of_traces_that_all_traces_refute_is_hopeless():
    task = planned(traces=[bench(0), bench(1)])
    calibrator = start_calibration(task)
    first, optimum = first_progress(task), calibrate(task).progress
    # A chamber of a quarter of the volume, said to have left as little of parts as the optimum.
    elsewhere = (*first.coordinates[:-1], first.coordinates[-1] - 1.4)
    places = [optimum.coordinates, elsewhere, first.coordinates]
    ended = [Ended(0.5, 3, "converged", places[0]), Ended(0.5, 3, "joined", elsewhere), Ended(9.0, 3, "stuck")]
    followed, reached = run_alone(_with_all_traces(calibrator, first, ended))
    assert [each.status for each in followed] == ["converged", "hopeless", "stuck"]
    (end,) = reached
    assert followed[0].steps == 3 + end.steps
    assert end.cost == pytest.approx(optimum.searched, rel=1e-6)


@pytest.mark.parametrize(("ceiling", "given_up"), [(1e-4, True), (np.inf, False)])
def test_a_search_that_is_far_above_its_ceiling_without_what_ran_away_is_given_up(ceiling, given_up, monkeypatch):
    task = dataclasses.replace(planned(), ceiling=ceiling)
    start = start_calibration(task)
    monkeypatch.setattr(_searches, "_without_runaways", lambda calibrator: start.at(first_progress(task)))
    end = run_alone(_searches.searching_once(start_calibration(task), quiet, rescues=1)).minimiser.progress
    assert end.given_up == given_up
    assert end.converged != given_up
    assert end.iteration == 0 or not given_up


def test_an_end_far_above_the_noise_is_tried_again_from_a_second_guess():
    """A preload that no vacuum overcomes: the rod never moves, whatever the stiffness is."""
    task = planned(values={"diaphragm.preload": 900.0})
    lost = calibrate(task)
    assert lost.progress.searched > FAR_OFF
    asked = []

    def guess(model, traces):
        asked.append(float(model.diaphragm.preload))
        return {"diaphragm.preload": 40.0, "diaphragm.mass": 3.0}  # the mass is not free

    found, alone = calibrate(dataclasses.replace(task, second_guess=guess)), calibrate(planned())
    assert asked == [900.0]
    np.testing.assert_allclose(found.values, alone.values, atol=0.02 * np.max(alone.std_errors), rtol=1e-4)
    assert calibrate(dataclasses.replace(planned(), second_guess=guess)).progress == alone.progress
    assert asked == [900.0]
    nothing = dataclasses.replace(task, second_guess=lambda model, traces: {})
    assert calibrate(nothing).progress == lost.progress


class _Flat(LevenbergMarquardt):
    """A search that stands at one misfit, all of whose columns are as long as given."""

    def __init__(self, cost, columns):
        self.progress = Progress((0.0, 0.0), history=(cost,))
        self.problem = SimpleNamespace(count=1000, transform=SimpleNamespace(clip=np.asarray))
        self.columns, self.residuals = np.diag(columns), np.array([1.0, 0.0])
        self.point = SimpleNamespace(reduced=Reduced(self.residuals, self.columns, 1000))

    def uncertainty(self):
        return estimate_uncertainty(self.residuals, self.columns, 1000)


def test_an_end_at_which_nothing_moves_catches_no_other_search():
    dead, alive = _Flat(40_000.0, [0.0, 0.0]), _Flat(0.6, [1.0, 1.0])
    assert not _Optimum.of(dead).is_ahead_of(alive)
    assert not _Optimum.of(_Flat(0.6, [0.0, 1.0])).is_ahead_of(alive)  # as deep, but one direction is not seen there
    assert _Optimum.of(_Flat(0.6, [1.0, 1.0])).is_ahead_of(alive)
    assert not _Optimum.of(_Flat(0.5, [1.0, 1.0])).is_ahead_of(alive)  # a step promises 1 of the 200 that are between


def test_traces_that_tell_nothing_are_all_kept(monkeypatch):
    task = planned(traces=[bench(0), bench(1)])
    search = start_calibration(task).minimiser
    monkeypatch.setattr(_telling, "FEW", 0)
    search.point = dataclasses.replace(search.point, columns=0 * search.point.columns)
    assert most_telling(task, search) == {number: len(trace.time) for number, trace in enumerate(task.fit)}
