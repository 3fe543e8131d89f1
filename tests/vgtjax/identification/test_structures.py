"""How the fits of structures begin beside each other, and which of them are given up."""

import dataclasses

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax import SimulationError
from vgtjax.estimation import (
    RECORDED,
    Linearised,
    Progress,
    Reading,
    Unknown,
    ask,
    calibrate,
    plan_task,
    run_alone,
    start_calibration,
)
from vgtjax.estimation.search._searches import FAR_ABOVE, MOST_TO_GO, TRIED, _is_hopeless
from vgtjax.identification import compare_structures
from vgtjax.identification.structures import _ranking, _structures
from vgtjax.identification.structures._ranking import ASTRAY, STRONG, Duel, RankedStructure, StructureRanking

COUNT = 2000
"""Measurements, so that chi^2 is as many times 2."""


@pytest.fixture(scope="module")
def task():
    return plan_task(vgtjax.Actuator(), [bench(1)], free=FREE)


@pytest.mark.parametrize(
    ("history", "hopeless"),
    [
        ((9.0, 5.0, 4.9, 4.89, 4.88), True),
        ((9.0, 5.0, 4.9, 4.89, 4.5), False),  # eleven steps more like the last one do
        ((9.0, 5.0, 4.9, 4.89), False),  # hardly begun
        ((0.9, 0.7, 0.62, 0.6, 0.6), False),  # near
    ],
)
def test_what_is_given_up(history, hopeless):
    progress = Progress((0.0,), history=history, iteration=len(history) - 1)
    assert _is_hopeless(progress, 0.5, COUNT) == hopeless
    assert not _is_hopeless(progress, np.inf, COUNT)


def test_limits_of_giving_up():
    """By hand: the last step brought a twentieth of the way, or the way is a chi^2 of so much."""
    above = FAR_ABOVE / (2 * COUNT)
    for far, gain, hopeless in (
        (1.01, 0.99 / MOST_TO_GO, True),
        (0.99, 0.0, False),
        (1.01, 1.03 / MOST_TO_GO, False),
    ):
        costs = (2.0,) * (TRIED - 1) + (0.5 + above * (far + gain), 0.5 + above * far)
        assert _is_hopeless(Progress((0.0,), history=costs, iteration=TRIED), 0.5, COUNT) == hopeless


def test_a_search_that_is_given_up_is_asked_nothing_more(task, monkeypatch):
    seen = []
    monkeypatch.setattr("vgtjax.estimation.search._searches.TRIED", 1)
    monkeypatch.setattr("vgtjax.estimation.search._searches.MOST_TO_GO", 0)
    found = start_calibration(dataclasses.replace(task, ceiling=-1e6)).run(seen.append)
    assert not found.converged
    assert found.verdict == "given up, far from what another structure reaches"
    assert len(seen) == 1
    again = start_calibration(task, dataclasses.replace(seen[-1], given_up=False)).run()
    assert again.converged
    assert not again.progress.given_up


def test_a_search_that_has_ended_far_above_another_structure_is_given_up(task, monkeypatch):
    monkeypatch.setattr("vgtjax.estimation.search._searches.FAR_ABOVE", 0.0)
    free, seen = start_calibration(task).run(), []
    reached = free.progress.searched
    for ceiling, given_up in ((reached * 1.001, False), (reached * 0.999, True)):
        found = start_calibration(dataclasses.replace(task, ceiling=ceiling)).run(seen.append)
        assert found.progress.given_up == given_up
        assert found.converged != given_up
    assert seen[-1].given_up
    # A run that was interrupted there ends there, too.
    again = start_calibration(dataclasses.replace(task, ceiling=reached * 0.999), seen[-1]).run()
    assert again.progress == seen[-1]


def test_derivatives_of_a_timely_duty_are_those_of_one_that_may_be_late(task):
    calibration = start_calibration(dataclasses.replace(task, unknown=Unknown())).run()
    assert not calibration.progress.late
    found = run_alone(Linearised.of(calibration))
    assert found.problem.delay_is_free
    expected = run_alone(ask(found.problem.evaluation(found.at, slopes=True)))
    for mine, theirs in zip(found.evaluated.columns, expected.columns, strict=True):
        mine, theirs = (each.reshape(-1, each.shape[-1]) for each in (mine, theirs))
        lengths = np.linalg.norm(theirs, axis=0)
        assert np.all(lengths > 0)
        # Rounding, which the seat's steep ramp multiplies; of columns as long as they are.
        assert np.all(np.linalg.norm(mine - theirs, axis=0) <= 1e-8 * lengths)


def test_a_structure_that_values_of_another_spoil_begins_at_its_own(task):
    begun = []

    def fitting(structure, begin):
        begun.append((structure["friction"], bool(begin.values), begin.ceiling))
        if structure["friction"] == "dahl" and begin.values:
            raise SimulationError("these values can't be simulated")
        return (yield from start_calibration(dataclasses.replace(task, ceiling=begin.ceiling)).steps())

    compared = compare_structures({"friction": "lugre"}, {"friction": ["lugre", "dahl"]}, fitting)
    assert compared.fit is not None
    reached = compared.fit.calibration.progress.searched
    assert begun == [("lugre", False, np.inf), ("dahl", True, reached), ("dahl", False, reached)]
    assert {row.name: row.reason for row in compared.rankings["friction"].rows} == {"lugre": "", "dahl": ""}


@pytest.fixture(scope="module")
def late():
    """The same task with a duty that reaches the valve 4 ms late, and its fit, which finds that out."""
    trace = bench(1)
    applied = trace.replace(pwm=np.concatenate([np.full(4, trace.pwm[0]), trace.pwm[:-4]]))
    run = vgtjax.simulate(vgtjax.Actuator(), applied)
    rng, count = np.random.default_rng(4), len(trace.time)
    seen = trace.replace(x_d=run.x_d + rng.normal(0, 8e-6, count), p_act=run.p_act + rng.normal(0, 60.0, count))
    task = plan_task(vgtjax.Actuator(), [seen], free=FREE, unknown=Unknown(duty_hold=False))
    return task, start_calibration(task).run()


def test_a_search_that_comes_near_by_the_other_ones_reading_of_the_duty_is_not_given_up(late):
    task, free = late
    assert free.progress.late
    assert free.duty_delay == pytest.approx(4e-3, abs=1e-3)
    limited = dataclasses.replace(task, ceiling=free.progress.searched)
    assert start_calibration(limited).run().progress.given_up
    reading = Reading(delay=free.duty_delay)
    seen = []
    found = start_calibration(dataclasses.replace(limited, reading=reading)).run(seen.append)
    assert found.progress == free.progress
    # A run that was interrupted ends there, too, whether it knew of the delay by then or not.
    for progress in (seen[0], next(each for each in seen if each.late)):
        again = start_calibration(dataclasses.replace(limited, reading=reading), progress).run()
        assert again.progress == free.progress


def test_a_search_that_is_far_above_by_either_reading_is_given_up(late):
    task, free = late
    hopeless = dataclasses.replace(task, ceiling=free.progress.searched - 1e3, reading=Reading(delay=free.duty_delay))
    seen = []
    assert start_calibration(hopeless).run(seen.append).progress.given_up
    assert not any(progress.late for progress in seen)


def test_others_begin_with_the_reading_by_which_a_structure_leaves_noise_only(late):
    task, free = late
    begun = []

    def fitting(structure, begin):
        begun.append(begin)
        return (yield from start_calibration(begin.of(task)).steps())

    compare_structures({"friction": "lugre"}, {"friction": ["lugre", "dahl"]}, fitting)
    assert (begun[0].ceiling, begun[0].reading) == (np.inf, RECORDED)
    assert (begun[1].ceiling, begun[1].reading) == (free.progress.searched, Reading(delay=free.duty_delay))


HELD = {"near": 57.3e-6, "far": 80e-6}
"""Volumes in m3 that cost some tens of chi^2 where they are held beside the truth, and thousands."""


def ranked_beside(task, changed, alike=None):
    """A fit with a free volume, changed by `changed`, against those with it held."""
    tasks = {"free": task} | {
        name: plan_task(vgtjax.Actuator(), task.fit, free=FREE[:2], values={"chamber.volume": volume})
        for name, volume in HELD.items()
    }

    def fitting(structure, begin):
        name = structure["friction"]
        return changed(name, (yield from start_calibration(tasks[name]).steps()))

    own, options = {"friction": "free"}, {"friction": list(tasks)}
    found = compare_structures(own, options, fitting, alike=alike).rankings["friction"]
    assert found.best == "free"
    near, far = (found.against[name] for name in HELD)
    assert STRONG < near.difference < ASTRAY < far.difference
    return near, far


@pytest.mark.parametrize("delay", [0.0, -1e-3])
def test_a_duty_that_comes_early_decides_only_what_is_far_apart(task, delay):
    near, far = ranked_beside(task, lambda name, fit: dataclasses.replace(fit, duty_delay=delay))
    assert bool(near.doubt) == (delay < 0)
    assert ("would come 1 ms early" in near.doubt) == (delay < 0)
    assert not far.doubt


@pytest.mark.parametrize("end", ["settled", "not settled", "no corrections"])
def test_a_fit_whose_corrections_have_not_settled_decides_only_what_is_farther_apart(task, monkeypatch, end):
    monkeypatch.setattr(_ranking, "RESTLESS", ASTRAY)  # between the two that this task has

    def restless(name, fit):
        once = {"corrections": 1, "history": (*fit.progress.history, fit.progress.cost)}
        progress = dataclasses.replace(fit.progress, **once, settled=end != "not settled" or name != "near")
        if end == "no corrections" and name == "near":  # of a task that has some: its search got stuck
            asked = dataclasses.replace(fit.task.unknown, loss="huber")
            return dataclasses.replace(fit, task=dataclasses.replace(fit.task, unknown=asked))
        return dataclasses.replace(fit, progress=progress)

    near, far = ranked_beside(task, restless)
    assert bool(near.doubt) == (end != "settled")
    assert ("have not settled, or it came to none" in near.doubt) == (end != "settled")
    assert not far.doubt


@pytest.mark.parametrize("alike", [True, False])
def test_variants_whose_parameters_make_up_for_each_other_are_decided_by_what_is_far_apart(task, monkeypatch, alike):
    monkeypatch.setattr(_ranking, "APART", ASTRAY)  # between the two that this task has
    near, far = ranked_beside(task, lambda name, fit: fit, {name: ("free",) for name in HELD} if alike else None)
    assert bool(near.doubt) == alike
    assert ("make up for what tells the two apart" in near.doubt) == alike
    assert not far.doubt


@pytest.mark.parametrize("alike", [True, False])
def test_fits_that_read_the_duty_differently_decide_only_what_is_far_apart(task, alike):
    def read(name, fit):
        linear = (1e-2,) if alike or name == "free" else ()
        return dataclasses.replace(fit, progress=dataclasses.replace(fit.progress, linear=linear))

    near, far = ranked_beside(task, read)
    assert bool(near.doubt) == (not alike)
    assert ("the two read the duty differently" in near.doubt) == (not alike)
    assert not far.doubt


def test_a_derivative_that_explodes_at_a_sample_leaves_the_rest_its_say(task):
    """It made the others too short to matter, so that a structure seemed to need one number."""
    fit = run_alone(Linearised.of(calibrate(task)))
    columns = [np.array(each) for each in fit.evaluated.columns]
    columns[0][3, 7, :, 0] *= 1e12
    exploded = dataclasses.replace(fit, evaluated=dataclasses.replace(fit.evaluated, columns=columns))
    known, found = (each.weighed(fit.calibration.sensors) for each in (fit, exploded))
    assert found.uncertainty.rank == known.uncertainty.rank == len(FREE)
    # Of 1000 samples one less.
    np.testing.assert_allclose(found.uncertainty.std_errors, known.uncertainty.std_errors, rtol=0.01)
    assert found.chi2 == known.chi2


@pytest.mark.parametrize(
    ("together", "structure", "doubt"),
    [
        (300.0, ("lugre", "map"), ""),  # beaten beside either
        (103.0, ("lugre", "map"), "with speed-map as vane_force: the criterion differs by {beside:g}"),
        (50.0, ("squared", "speed-map"), ""),  # better with both changed
    ],
)
@pytest.mark.parametrize("other", [105.0, 95.0])
def test_what_is_beaten_is_tried_beside_what_is_not(monkeypatch, together, structure, doubt, other):
    """Squared friction is beaten by a hundred beside one vane force, which is not told from another, a little better or
    worse, beside which it may be better."""
    criteria = {
        ("lugre", "map"): 100.0,
        ("lugre", "speed-map"): other,
        ("squared", "map"): 200.0,
        ("squared", "speed-map"): together,
    }
    fitted = []

    def fit(search, structure, begin):
        yield from ()
        fitted.append(tuple(structure.values()))
        search._fits[fitted[-1]] = criteria[fitted[-1]]

    def rank(outcomes, wider=None, alike=None):
        yield from ()
        best = min(outcomes, key=outcomes.get)
        apart = {name: each - outcomes[best] for name, each in outcomes.items() if name != best}
        why = {name: "" if each > STRONG else f"the criterion differs by {each:g}" for name, each in apart.items()}
        duels = {name: Duel(each, 0.0, None, why[name]) for name, each in apart.items()}
        return StructureRanking([RankedStructure(name) for name in outcomes], best, duels, "none")

    monkeypatch.setattr(_structures._Search, "_fit", fit)
    monkeypatch.setattr(_structures._Search, "usable", lambda search, structure: None)
    monkeypatch.setattr(_structures, "rank", rank)
    options = {"friction": ["lugre", "squared"], "vane_force": ["map", "speed-map"]}
    found = compare_structures({"friction": "lugre", "vane_force": "map"}, options, lambda structure, begin: None)
    assert (tuple(found.structure.values()), found.settled) == (structure, True)
    rival = {"lugre": "squared", "squared": "lugre"}[structure[0]]
    assert found.rankings["friction"].against[rival].doubt == doubt.format(beside=abs(together - other))
    assert set(fitted) == set(criteria)
    lines = repr(found.rankings["friction"]).splitlines()
    assert lines[0] == f"Structures, best first, scored on none: {found.rankings['friction'].best}"
    assert next(line for line in lines if line.startswith(rival)).endswith(
        found.rankings["friction"].against[rival].doubt
    )
