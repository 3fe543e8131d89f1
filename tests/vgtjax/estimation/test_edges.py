"""A duty that jumps between the samples of its record: where its edges are is found, and spoils no parameter."""

import copy
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.signal
from known_truth import FREE, NOISE, TRUTH, missed_when_applied
from support import duty_trace

import vgtjax
from vgtjax import simulate
from vgtjax.estimation import Progress, Unknown, plan_task, start_calibration
from vgtjax.estimation.derivatives._bundle import bundle_traces
from vgtjax.estimation.derivatives._evaluation import Evaluation, ask
from vgtjax.estimation.derivatives._programs import run_alone
from vgtjax.estimation.duty import _duty_questions
from vgtjax.estimation.duty._edges import alike, edges_of, find_edges, possible, show_in, whole_samples
from vgtjax.estimation.measurements._duties import as_recorded
from vgtjax.estimation.search._beginning import first_progress, problem_of
from vgtjax.estimation.search._noise_met import meets_noise
from vgtjax.estimation.search._point import misfit_at
from vgtjax.estimation.search._progress import quiet
from vgtjax.estimation.search._searches import searching_once
from vgtjax.estimation.search._slopes import Slopes

LEVELS = (0, 0.051), (70, 0.152), (40, 0.149), (60, 0.151), (30, 0.148), (65, 0.151), (0, 0.15)
"""Edges at 51, 203, 352, 503, 651 and 802 ms: every second one lies between the samples of a record with 500 Hz."""
ALIKE = (0, 0.051), (70, 0.152), (40, 0.15), (60, 0.15), (30, 0.148), (65, 0.152), (0, 0.15)
"""Edges at 51, 203, 353, 503, 651 and 803 ms: all of them do."""
LATE = (-0.5, -0.5, 0.0, -0.5, -0.5, 0.0)
"""Samples of that record."""
CHOICES = Unknown(duty_hold="evidence", noise="white", loss="gaussian", numerics=False, start_state=False)


def recorded(seed, keep=2, levels=LEVELS, louder=1.0, late=0):
    """Every second sample of what a bench shows that runs at 1 kHz, with a duty that reaches the valve `late` ms after
    its record."""
    trace, rng = duty_trace(*levels, p_res=2.0e4), np.random.default_rng(seed)
    run = simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), trace)
    x_d = np.asarray(run.x_d) + rng.normal(0, louder * NOISE["x_d"], len(trace.time))
    p_act = np.asarray(run.p_act) + rng.normal(0, louder * NOISE["p_act"], len(trace.time))
    every = slice(None, None, keep)
    duty = np.append(trace.pwm[late:], np.full(late, trace.pwm[-1]))
    kept = {"pwm": duty, "p_res": trace.p_res, "x_d": x_d, "p_act": p_act}
    return vgtjax.Trace(trace.time[every], **{name: each[every] for name, each in kept.items()}, name=f"run {seed}")


def task_of(*traces, **changes):
    return plan_task(vgtjax.Actuator(), traces, free=FREE, unknown=dataclasses.replace(CHOICES, **changes))


def scores(found):
    """Errors of the parameters in standard errors."""
    truth = [TRUTH[entry] for entry in found.task.selection.entries]
    return (found.values - truth) / found.std_errors


@pytest.fixture(scope="module")
def found():
    return start_calibration(task_of(recorded(1), recorded(2))).run()


def test_parameters_are_right_although_edges_are_recorded_late(found):
    assert found.converged
    assert found.uncertainty.scale == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(scores(found)) < 4)


def test_edges_are_where_they_were(found):
    """Nearer to where each was than to where it was not; the noise leaves them known to 0.05 samples or so."""
    for edges in found.progress.edges:
        np.testing.assert_allclose(edges, LATE, atol=0.25)
    late = found.late_edges(found.task.fit[0])
    np.testing.assert_allclose(late, 2e-3 * np.array(found.progress.edges[0]))


def test_edges_beside_a_late_duty():
    """3 ms late at 500 Hz: edges that the record shows on time are 1.5 samples late, and others one. Of a search with a
    delay only, values of the plunger were five to a hundred standard errors off."""
    found = start_calibration(task_of(recorded(1, late=3), recorded(2, late=3))).run()
    assert found.converged
    assert np.all(np.abs(scores(found)) < 4)
    for trace in found.task.fit:
        # Recorded at 48, 200, 350, ... ms.
        late = found.duty_delay + np.array(found.late_edges(trace))
        np.testing.assert_allclose(late, 1e-3 * np.array([3, 3, 2, 3, 3, 2]), atol=5e-4)
        position, pressure = missed_when_applied(found, trace)
        assert position < 1e-8  # of the same simulation
        assert pressure < 0.1


def with_outliers(trace, rng):
    """One sample of the pressure in a hundred is off by thirty deviations."""
    far = 30 * NOISE["p_act"] * rng.choice([-1.0, 1.0], len(trace.time)) * (rng.random(len(trace.time)) < 0.01)
    return trace.replace(p_act=trace.p_act + far)


def behind_a_filter(trace, rng):
    """The pressure has twice its noise besides, behind a low-pass of 40 Hz."""
    keep = np.exp(-2 * np.pi * 40.0 * (trace.time[1] - trace.time[0]))
    noise = rng.normal(0, 2 * NOISE["p_act"] * np.sqrt(1 - keep**2), len(trace.time))
    return trace.replace(p_act=trace.p_act + scipy.signal.lfilter([1.0], [1.0, -keep], noise))


@pytest.mark.parametrize("second_fault", [with_outliers, behind_a_filter])
def test_a_second_fault_hides_no_edges_beside_a_late_duty(second_fault):
    """Of which no search knows before its corrections: edges that met the traces were given up, as these seemed not
    met, and parameters of good campaigns were far off."""
    traces = [second_fault(recorded(seed, late=3), np.random.default_rng(seed + 10)) for seed in (1, 2)]
    found = start_calibration(task_of(*traces, loss="evidence", noise="evidence")).run()
    assert found.converged
    assert all(found.progress.edges)
    assert np.all(np.abs(scores(found)) < 4)
    assert max(found.noise_ratios.values()) < 1.1  # of 600 samples a channel, known to 6 %


def test_a_delay_moves_placed_edges_by_what_they_move():
    """A tenth of a millisecond: the trace itself stays, the problem adds what all of its edges move, and that is nearly
    what a simulation with later edges shows."""
    late = recorded(1, late=3)
    task = dataclasses.replace(task_of(late), edges=as_recorded([late]), edges_delay=3e-3)
    progress = dataclasses.replace(first_progress(task), late=True)
    problem = problem_of(task, progress)
    here = np.array([*progress.coordinates[:-1], 3e-3 / float(problem.transform.scale[-1])])
    beyond = here + np.append(np.zeros(len(here) - 1), 1e-4 / float(problem.transform.scale[-1]))
    edges = run_alone(edges_of(task, problem, task.edges, here, delay=True))
    problem = problem.with_edges(edges)
    placed, stays = (run_alone(ask(problem.evaluation(at))) for at in (here, beyond))
    np.testing.assert_array_equal(stays.observed[0], placed.observed[0])
    moved = problem.beside_edges(stays, beyond).observed[0] - placed.observed[0]
    columns = run_alone(Slopes.find(problem, beyond))
    traced = (*problem.residuals_and_jacobian(beyond), problem.residuals(beyond))
    searched = run_alone(misfit_at(problem, beyond)), problem.columns_of(columns.evaluated.columns, beyond)
    for mine, theirs in zip(traced, (*searched, searched[0]), strict=True):
        # The same numbers by other programs.
        np.testing.assert_allclose(np.sqrt(problem.count) * np.asarray(mine), theirs, rtol=1e-6, atol=1e-7)
    later = bundle_traces(task.model, [late.with_late_edges([0.0] * len(LATE), 3.1e-3)])
    simulated = run_alone(ask(Evaluation(problem.at(here)[0], later))).observed[0] - placed.observed[0]
    for channel in range(2):
        # Of steps that fall elsewhere as well; measured: 0.18 and 0.15.
        assert np.linalg.norm((moved - simulated)[..., channel]) < 0.3 * np.linalg.norm(moved[..., channel])


def test_read_as_recorded_they_spoil_parameters(found):
    progress = dataclasses.replace(found.progress, edges=(), edges_seen=(), converged=False, iteration=0, corrections=0)
    blind = start_calibration(task_of(*found.task.fit, duty_delay=False), Progress(progress.coordinates[:3])).run()
    assert np.max(np.abs(scores(blind))) > 5
    assert blind.uncertainty.scale > 1.2


def test_edges_on_samples_are_left_where_they_are():
    whole = start_calibration(task_of(recorded(3, keep=1))).run()
    assert whole.progress.edges == ()
    assert whole.late_edges(whole.task.fit[0]) == []


def test_what_is_not_known_of_edges_is_in_the_errors(found):
    """Against the same problem with edges that are known: errors grow, and none falls."""
    end = start_calibration(found.task, dataclasses.replace(found.progress, corrections=0, converged=False))
    free = end.minimiser.problem
    known = free.without_edges()
    columns = [
        problem.columns_of(end.minimiser.slopes.evaluated.columns, end.minimiser.slopes.at) for problem in (free, known)
    ]
    wide, narrow = (np.sqrt(np.diag(np.linalg.inv(each[:, :3].T @ each[:, :3]))) for each in columns)
    assert np.all(wide >= narrow * (1 - 1e-9))
    assert np.max(wide / narrow) > 1.2


def test_residuals_are_whitened_by_what_edges_may_do(found):
    """By hand: the covariance `1 + E C E^T` of a trace, whose inverse root multiplies residuals."""
    task = dataclasses.replace(found.task, fit=found.task.fit[:1], edges=())
    progress = dataclasses.replace(found.progress, edges=(), edges_seen=(), corrections=0, converged=False)
    search = start_calibration(task, progress).minimiser
    edges = ((0.0,) * len(LATE),)
    steps = edges_of(task, search.problem, edges, search.slopes.at, delay=False)
    found = run_alone(steps)
    free = search.problem.with_edges(found)
    later = search.problem.whitened(found.responses)
    responses = later @ np.linalg.cholesky(np.eye(len(LATE)) / 12 + 1.0)
    plain = search.problem.residuals_of(search.slopes.evaluated.observed) - 0.5 * later.sum(axis=1)
    sizes, ways = np.linalg.eigh(responses.T @ responses)
    basis = responses @ ways / np.sqrt(sizes)
    expected = plain - basis @ ((1 - 1 / np.sqrt(1 + sizes)) * (basis.T @ plain))
    np.testing.assert_allclose(
        free.residuals_of(search.slopes.evaluated.observed), expected, atol=1e-8 * np.max(np.abs(plain))
    )
    assert free.offsets == search.problem.offsets + len(LATE)
    assert find_edges(free, search.slopes).evident


def test_what_edges_have_in_common_is_a_delay():
    """By hand: edges that are 4 ms late, of which a record with 500 Hz shows two of three half a sample late."""
    trace = recorded(1)
    whole, rest = whole_samples([trace], 0.0, ((2.0, 1.5, 1.5, 2.0),))
    assert whole == pytest.approx(4e-3)
    np.testing.assert_allclose(rest, [(0.0, -0.5, -0.5, 0.0)], atol=1e-12)
    whole, rest = whole_samples([trace], 3.5e-3, ((0.25, -0.25, 0.3, -0.3),))
    assert whole == pytest.approx(4e-3)
    np.testing.assert_allclose(rest, [(0.0, -0.5, 0.05, -0.55)], atol=1e-12)


@pytest.mark.parametrize(("levels", "differ"), [(LEVELS, True), (ALIKE, False)], ids=["differ", "alike"])
def test_what_edges_tell_beyond_a_delay(levels, differ):
    """All half a sample early are a delay of that, but for what a linear step leaves over; measured: 0.81 and 0.07."""
    calibrator = start_calibration(task_of(recorded(1, levels=levels)))
    task, search = calibrator.task, calibrator.minimiser
    while not search.progress.finished:
        search.step()
    edges = ((0.0,) * len(LATE),)
    knowing = search.problem.with_edges(run_alone(edges_of(task, search.problem, edges, search.slopes.at, delay=False)))
    found = find_edges(knowing, search.slopes)
    assert found.evident
    part = find_edges(knowing, search.slopes, beyond_delays=True).gain / found.gain
    assert part > 0.5 if differ else part < 0.1


def test_edges_that_are_all_as_late_leave_parameters_right():
    """Asked as edges that differ they end alike, so that a delay is asked for first."""
    again = start_calibration(task_of(recorded(1, levels=ALIKE))).run()
    assert again.converged
    assert alike(again.progress.edges)
    assert np.all(np.abs(scores(again)) < 4)


def test_edges_that_differ_are_found_without_a_free_delay(found, monkeypatch):
    """Searches with a free delay followed the mean of such edges, a duty that came early, and lost the plunger."""

    def refused(*_):
        raise AssertionError("no search with a free delay is needed")

    monkeypatch.setattr(_duty_questions, "_searching_late", refused)
    again = start_calibration(found.task).run()
    assert again.converged
    np.testing.assert_array_equal(again.values, found.values)


@pytest.mark.parametrize("costs", [(0.50, 0.45), (0.45, 0.50)], ids=["from the start", "from the end"])
def test_edges_are_searched_from_the_end_and_from_the_start(found, monkeypatch, costs):
    """The second search knows the edges of the first, and the better one counts."""
    ended, tried = run_alone(searching_once(start_calibration(found.task), quiet)), []
    answers = iter(costs)

    def searching(_, onward):
        tried.append(onward)
        yield from ()
        return told_end(ended, dataclasses.replace(onward, edges=found.progress.edges, history=(next(answers),)))

    monkeypatch.setattr(_duty_questions, "_searching_edges", searching)
    best = run_alone(_duty_questions._asking_of_edges(ended, quiet, differing=True))
    assert best.minimiser.progress.searched == 0.45
    progress = ended.minimiser.progress
    assert [each.coordinates[:-1] for each in tried] == [progress.coordinates[:-1], progress.began[:-1]]
    assert tried[1].edges == found.progress.edges


def test_edges_later_than_their_record_are_not_searched_on_without_a_delay(found, monkeypatch):
    ended, tried = run_alone(searching_once(start_calibration(found.task), quiet)), []

    def searching(_, onward):
        tried.append(onward)
        yield from ()
        return told_end(ended, dataclasses.replace(onward, edges=((0.8,) * len(LATE),) * 2, history=(0.45,)))

    monkeypatch.setattr(_duty_questions, "_searching_edges", searching)
    assert run_alone(_duty_questions._asking_of_edges(ended, quiet, differing=True)) is ended
    assert len(tried) == 1


def told_end(ended, progress):
    """The end of a search that did not run."""
    minimiser = copy.copy(ended.minimiser)
    minimiser.progress = progress
    return SimpleNamespace(task=ended.task, minimiser=minimiser, is_lost=lambda: False, worth=ended.worth)


def test_edges_are_found_that_hardly_show():
    """Read as recorded they leave 1.03 times the noise here; in two campaigns of 25 that was taken for the noise, with
    errors of four standard errors."""
    found = start_calibration(task_of(recorded(1, louder=5.0), recorded(2, louder=5.0))).run()
    blind = 2 * found.progress.history[1]
    assert 1.0 < blind < 1.05
    assert found.converged
    assert found.progress.edges
    assert np.all(np.abs(scores(found)) < 3)


def test_edges_that_end_as_late_as_each_other_are_a_delay():
    """By hand: a trace whose edges scatter is enough to tell them from a delay, one without edges says nothing."""
    assert alike(((0.5, 0.52, 0.48), ()))
    assert not alike(((0.5, 0.5, 0.5), LATE))


def test_edges_of_one_trace_lie_within_a_sample():
    """Each is recorded at the first sample behind it, however late all of them are; and not later than that."""
    assert possible(((0.1, -0.5, 0.6), (3.0, 2.9), ()), delay=True)
    assert not possible(((0.0, 0.0), (-0.1, 1.2)), delay=True)
    assert possible(((0.1, -0.5), ()), delay=False)
    assert not possible(((0.1, -0.5), (0.5,)), delay=False)


@pytest.mark.parametrize(("keep", "tells"), [(2, True), (1, False)])
def test_residuals_tell_of_edges_before_anything_is_simulated(keep, tells):
    """Where the misfit is taken for the noise, as noise is five times that of the other tests."""
    calibrator = start_calibration(task_of(recorded(1, keep, louder=5.0), recorded(2, keep, louder=5.0)))
    search = calibrator.minimiser
    while not search.progress.finished:
        search.step()
    assert show_in(search.problem, search.slopes, calibrator.task.fit) == tells


def ramp(seed, *, linear=True, louder=1.0):
    """A duty that rises and falls by 130 % a second, recorded at 100 Hz: in lines, or in stairs of that."""
    time, rng = 1e-3 * np.arange(1500), np.random.default_rng(seed)
    duty = 80 * np.clip(1 - np.abs(time - 0.7) / 0.6, 0, None)
    applied = duty if linear else np.repeat(duty[::10], 10)
    drive = vgtjax.Trace(
        time, pwm=applied, p_res=np.full_like(time, 2.0e4), duty_hold="linear" if linear else "zero-order"
    )
    run = vgtjax.simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), drive)
    noise = {name: rng.normal(0, louder * NOISE[name], len(time)) for name in ("x_d", "p_act")}
    seen = {name: np.asarray(getattr(run, name)) + each for name, each in noise.items()}
    trace = vgtjax.Trace(time, pwm=applied, p_res=drive.p_res, name="ramp", **seen)
    every = slice(None, None, 10)
    return vgtjax.Trace(
        time[every], name="ramp", **{name: getattr(trace, name)[every] for name in ("pwm", "p_res", "x_d", "p_act")}
    )


@pytest.mark.parametrize("linear", [True, False])
def test_slow_traces_beside_edges_are_read_as_they_were(linear):
    """A search for edges alone took from the slow traces what comes of reading them half a sample late."""
    found = start_calibration(task_of(recorded(1), recorded(2), ramp(3, linear=linear))).run()
    progress = found.progress
    assert found.converged
    assert progress.linear == ((1e-2,) if linear else ())
    assert progress.hold_decided
    assert [len(edges) > 0 for edges in progress.edges] == [True, True, False]
    assert found.duty_hold(found.task.fit[2]) == ("linear" if linear else "zero-order")
    assert found.duty_hold(found.task.fit[0]) == "zero-order"
    assert abs(found.duty_delay) < 4 * (found.duty_delay_error or 1e-5)
    assert np.all(np.abs(scores(found)) < 4)


@pytest.mark.parametrize("linear", [True, False])
def test_slow_traces_beside_edges_on_samples_are_read_as_they_were(linear):
    """Quick ones, ten times as many samples, hide the misfit of a slow one that is read half a sample late."""
    traces = recorded(1, 1), recorded(2, 1), recorded(3, 1), ramp(3, linear=linear, louder=8.0)
    as_held = start_calibration(task_of(*traces, duty_delay=False, duty_hold=False)).minimiser
    while not as_held.progress.finished:
        as_held.step()
    assert meets_noise(as_held)
    found = start_calibration(task_of(*traces)).run()
    assert found.converged
    assert found.progress.linear == ((1e-2,) if linear else ())
    assert not any(found.progress.edges)
    assert not found.progress.late
    assert np.all(np.abs(scores(found)) < 4)
