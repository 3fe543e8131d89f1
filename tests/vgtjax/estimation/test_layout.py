"""Traces of several rates and lengths: laid out in few shapes, and the answers that each would get alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax.estimation import (
    Evaluation,
    ask,
    bundle_traces,
    foreseen,
    observe,
    plan_task,
    run_alone,
    run_together,
)
from vgtjax.estimation.derivatives import _layout
from vgtjax.estimation.derivatives._sensitivities import observe_backwards, observe_with_jacobian
from vgtjax.estimation.measurements._measured import measure, white_sensors
from vgtjax.parameters import select

FREE = ["diaphragm.stiffness", "chamber.volume", "converter.plunger_mass"]
LATE = 4.3e-3


def recorded(every, seed, *levels):
    """A run of which every so many milliseconds a sample was kept, with a reservoir that is not constant."""
    fine, rng = duty_trace(*levels), np.random.default_rng(seed)
    time, pwm = fine.time[::every], fine.pwm[::every]
    pressure = 2.0e4 + 500 * rng.normal(size=len(time))
    return vgtjax.Trace(time, pwm=pwm, p_res=pressure, x_d=np.zeros(len(time)), p_act=np.full(len(time), 101013.0))


SLOW = recorded(10, 0, (0, 0.05), (70, 1.3), (20, 0.2))
FAST = recorded(2, 1, (0, 0.05), (60, 0.1), (90, 0.05))
OTHER = recorded(10, 2, (0, 0.05), (50, 0.12))


@pytest.fixture(scope="module")
def shared(actuator):
    """The slow records and the fast one in one shape."""
    return bundle_traces(actuator, [SLOW, FAST, OTHER])


def test_records_of_two_rates_share_a_shape(shared):
    assert [each.indices for each in shared] == [(0, 2), (1,)]
    assert [int(each.plan.substeps) for each in shared] == [20, 4]
    assert shared[0].shape == shared[1].shape == (4, 2, 6)


def test_reverse_mode_and_residuals_of_two_rates_share_their_programs(shared):
    sensors = white_sensors([SLOW, FAST, OTHER], ["p_act"])
    alike = [(each.reversible(), measure(each, [SLOW, FAST, OTHER], sensors)) for each in shared]
    assert jax.tree.structure(alike[0]) == jax.tree.structure(alike[1])
    assert [np.shape(leaf) for leaf in jax.tree.leaves(alike[0])] == [
        np.shape(leaf) for leaf in jax.tree.leaves(alike[1])
    ]


def test_a_shape_that_takes_too_much_room_is_not_shared(actuator, monkeypatch):
    monkeypatch.setattr(_layout, "MOST_ROOM", 1.4)
    apart = bundle_traces(actuator, [SLOW, FAST, OTHER])
    assert [each.shape for each in apart] == [(4, 2, 6), (2, 1, 2)]


@pytest.mark.parametrize("late", [None, LATE])
def test_values_and_derivatives_are_those_of_each_alone(shared, actuator, late):
    selection, delay = select(actuator, FREE), None if late is None else jnp.asarray(late)
    found = {}

    def derive(bundle):
        observed, columns, ended = observe_with_jacobian(actuator, selection, bundle, delay)
        assert bool(jnp.all(ended == vgtjax.RESULTS.successful))
        return observed, columns

    for bundle in shared:
        values, columns = (bundle.from_lanes(np.asarray(each)) for each in derive(bundle))
        found |= dict(zip(bundle.indices, zip(values, columns, strict=True), strict=True))
    for number, trace in enumerate((SLOW, FAST, OTHER)):
        (bundle,) = bundle_traces(actuator, [trace])
        for mine, theirs in zip(found[number], derive(bundle), strict=True):
            (theirs,) = bundle.from_lanes(np.asarray(theirs))
            # Rounding, which the seat's steep ramp multiplies; of columns as long as they are.
            assert np.all(np.linalg.norm(mine - theirs, axis=0) <= 1e-9 * np.linalg.norm(theirs, axis=0))


@pytest.mark.parametrize("late", [None, LATE])
def test_fits_side_by_side_get_the_derivatives_of_each_alone(actuator, late):
    """Lanes of several chunks, the last one partly filled; and beside it a shape of which one chunk is used."""
    long = bundle_traces(actuator, [recorded(2, 6, (0, 0.05), (70, 1.0), (20, 0.75))])
    short = bundle_traces(actuator, [FAST], like=long)
    assert short[0].shape == long[0].shape
    assert (short[0].owned, long[0].owned) == (2, 18)
    selection, found = select(actuator, FREE), {}
    questions = {each[0].owned: Evaluation(actuator, each, late, selection) for each in (long, short)}
    run_together({owned: ask(each) for owned, each in questions.items()}, found.__setitem__)
    run_together({"alone": ask(questions[2])}, found.__setitem__)
    np.testing.assert_array_equal(found["alone"].columns[0], found[2].columns[0])  # whatever runs beside it
    for owned, each in questions.items():
        expected = run_alone(ask(each)).columns[0]
        lengths = np.linalg.norm(expected[:owned], axis=(0, 1))
        assert np.all(lengths[1] > 0)
        # Rounding, which the seat's steep ramp multiplies; of columns as long as they are.
        assert np.all(np.linalg.norm(found[owned].columns[0] - expected, axis=(0, 1)) <= 1e-9 * lengths)


def test_reverse_mode_finds_what_forward_mode_does_in_a_shape_with_room(shared, actuator):
    selection, bundle = select(actuator, FREE), shared[1]
    observed, columns, _ = observe_with_jacobian(actuator, selection, bundle)
    cotangent = np.random.default_rng(2).normal(size=observed.shape) * [1e5, 1e-2]
    expected = np.einsum("lsc,lscp->p", cotangent, np.asarray(columns))
    found = observe_backwards(actuator, selection, bundle, None, jnp.asarray(cotangent))
    np.testing.assert_allclose(found, expected, rtol=1e-9)  # rounding


def test_what_has_room_in_the_shape_of_others_is_laid_out_there(shared, actuator):
    """At another rate, two beside each other; what is longer has a shape of its own."""
    medium = recorded(5, 4, (0, 0.05), (60, 0.2))
    longer = recorded(5, 5, (0, 0.05), (60, 1.5))
    bundles = bundle_traces(actuator, [medium, medium, longer, medium], like=shared)
    assert [each.indices for each in bundles] == [(0, 1), (3,), (2,)]
    assert bundles[0].shape == bundles[1].shape == shared[0].shape != bundles[2].shape
    (alone,) = bundle_traces(actuator, [medium])
    (expected,) = alone.from_lanes(np.asarray(observe(actuator, alone)[0]))
    (found,) = bundles[1].from_lanes(np.asarray(observe(actuator, bundles[1])[0]))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_shapes_are_few(actuator):
    """Runs of 30 s at 100 Hz, a little longer each."""
    shapes = set()
    for more in np.arange(0.0, 1.2, 0.1):
        bundles = bundle_traces(actuator, [recorded(10, 0, (0, 30.0 + more))])
        shapes |= {each.shape for each in bundles}
    assert len(shapes) == 3  # 60, 62 and 64 segments of half a second


@pytest.fixture
def task():
    def noisy(trace, seed):
        run, rng = vgtjax.simulate(vgtjax.Actuator(), trace), np.random.default_rng(seed)
        return trace.replace(
            x_d=np.asarray(run.x_d) + rng.normal(0, 8e-6, len(trace.time)),
            p_act=np.asarray(run.p_act) + rng.normal(0, 60.0, len(trace.time)),
        )

    return plan_task(vgtjax.Actuator(), [noisy(FAST, 0), noisy(OTHER, 1)], free=FREE[:2])


@pytest.mark.parametrize("together", [False, True])
def test_programs_that_are_foreseen_are_those_that_are_asked_for(task, tmp_path, monkeypatch, together):
    monkeypatch.setattr(vgtjax._kept, "FOLDER", tmp_path)
    questions = foreseen(task)
    programs = vgtjax.estimation.derivatives._programs
    prepare = programs._prepare_together if together else programs._prepare_alone
    for question in questions:
        prepare(question)
    prepared = {file.name for file in tmp_path.iterdir()}
    assert prepared

    def asking(question):
        return (yield question)

    for question in questions:
        if together:
            run_together({"only": asking(question)}, lambda name, answer: None)
        else:
            run_alone(asking(question))
    assert {file.name for file in tmp_path.iterdir()} == prepared
