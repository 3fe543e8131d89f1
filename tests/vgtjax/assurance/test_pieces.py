"""Standard runs in pieces that have room in the programs of shorter traces: they tell what whole runs do."""

import jax
import numpy as np
import pytest
from known_truth import FREE, sharp_bench

import vgtjax
from vgtjax.assurance import _next_run, examine, next_runs, ranking
from vgtjax.assurance._pieces import LEAD, cut, joined
from vgtjax.estimation import bundle_traces, plan_task
from vgtjax.experiments import StandardRun

LONG = StandardRun("levels", 7.0, 250.0)


@pytest.fixture(scope="module")
def task():
    """Of three seconds, in whose programs `LONG` has no room."""
    recorded = sharp_bench(4, StandardRun("levels", 3.0, 250.0).trace(reservoir=2.0e4, seed=1))
    return plan_task(vgtjax.Actuator(), [recorded], free=FREE)


@pytest.mark.parametrize("longest", [500, 501, 777, 1749])
def test_pieces_are_the_run_and_no_longer_than_said(longest):
    run = LONG.trace()
    pieces = cut(run, longest)
    lengths = [len(piece.trace.time) for piece in pieces]
    assert len(pieces) > 1
    assert max(lengths) <= longest
    assert [piece.lead for piece in pieces] == [0] + [round(LEAD * LONG.rate)] * (len(pieces) - 1)
    whole = joined(pieces, [np.stack([each.trace.time, each.trace.pwm], axis=-1)[..., None] for each in pieces])
    np.testing.assert_array_equal(whole[..., 0], np.stack([run.time, run.pwm], axis=-1))


@pytest.mark.parametrize("longest", [0, 499, 1750])
def test_a_run_that_has_room_or_whose_pieces_would_be_mostly_lead_stays_whole(longest):
    run = LONG.trace()
    assert [(piece.trace, piece.lead) for piece in cut(run, longest)] == [(run, 0)]


@pytest.mark.parametrize("longest", [0, 1])
def test_a_run_sampled_more_rarely_than_its_lead_stays_whole_where_nothing_has_room(longest):
    run = StandardRun("slow loop", 30.0, 0.4).trace()
    assert [piece.trace for piece in cut(run, longest)] == [run]


def test_runs_of_a_model_with_tables_stay_whole(task, monkeypatch):
    monkeypatch.setattr(_next_run, "has_tables", lambda model: True)
    (asked,) = next(ranking(task, examine(task), [LONG]))
    (bundle,) = asked.bundles
    assert bundle.samples.tolist() == [1750]


def test_a_long_run_needs_no_other_programs_than_those_of_the_traces(task):
    (asked,) = next(ranking(task, examine(task), [LONG]))
    (recorded,) = bundle_traces(asked.model, task.fit, task.steps)

    def program(bundle):
        return jax.tree.structure(bundle), [(np.shape(leaf), leaf.dtype) for leaf in jax.tree.leaves(bundle)]

    assert len(asked.bundles) > 1
    assert all(program(bundle) == program(recorded) for bundle in asked.bundles)


def test_a_run_in_pieces_tells_what_the_whole_one_does(task, monkeypatch):
    known = examine(task)
    (pieces,) = next_runs(task, known, [LONG])
    monkeypatch.setattr(_next_run, "longest_like", lambda *_: 0)
    (whole,) = next_runs(task, known, [LONG])
    assert whole.factor > 1.5
    # Where friction has left the rod where a piece begins is not quite forgotten after its lead: 0.2 % here.
    assert list(pieces.after.values()) == pytest.approx(list(whole.after.values()), rel=0.01)
