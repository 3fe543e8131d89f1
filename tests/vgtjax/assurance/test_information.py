"""What traces can tell: null directions of equations that we know, errors against the closed form, the next run."""

import numpy as np
import pytest
from known_truth import FREE, NOISE, TRUTH, bench, sharp_bench

import vgtjax
from vgtjax.assurance import Gain, Information, examine, next_runs, remedies
from vgtjax.estimation import calibrate, estimate_uncertainty, plan_task
from vgtjax.experiments import STANDARD_RUNS, StandardRun
from vgtjax.identification import plan_fit

RNG = np.random.default_rng(3)
ROWS = RNG.normal(size=(50, 6))


def information(columns):
    names = tuple("abcdefgh"[: columns.shape[1]])
    return Information(names, np.ones(columns.shape[1]), columns)


def test_errors_are_those_of_linear_least_squares():
    columns = ROWS[:, :3] * [1.0, 1e4, 1e-3]
    expected = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    assert list(information(columns).errors.values()) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("sizes", [(1.0, 1.0, 1.0), (1.0, 1e-2, 30.0)])
def test_groups_that_change_nothing_together_are_found_apart(sizes):
    """Two equal columns, and three whose sum is zero, in a hundredth of the size of others."""
    a, b, c = (size * column for size, column in zip(sizes, ROWS[:, :3].T, strict=True))
    columns = np.column_stack([a, a, b, c, -b - c, ROWS[:, 5]])
    known = information(columns)
    assert known.null == [["a", "b"], ["c", "d", "e"]]
    assert np.isfinite(known.errors["f"])
    assert all(np.isinf(known.errors[name]) for name in "abcde")


def test_groups_that_share_an_entry_are_told_by_the_fewest():
    """Scaling of a part, and of the whole, as of plunger and diaphragm."""
    part, whole = np.array([1.0, 1.0, 0.0, 0.0, 0.0]), np.array([1.0, 1.0, 1.0, 1.0, 0.0])
    basis = np.linalg.svd(np.vstack([part, whole]))[2][2:]
    known = information(ROWS[:, :3] @ basis)
    assert known.null == [["a", "b"], ["c", "d"]]


def test_what_no_trace_feels_is_no_group():
    columns = np.column_stack([ROWS[:, 0], np.zeros(50)])
    known = information(columns)
    assert (known.without_effect, known.null) == (["b"], [])
    assert known.summary()["null"] == [["b"]]
    assert known.sentences == ["no trace depends on b: excite what depends on it, or hold it"]


def test_what_moves_nothing_but_by_rounding_is_not_told():
    known = Information.by("ab", np.ones(2), np.column_stack([ROWS[:, 0], 1e-12 * ROWS[:, 1]]))
    assert (known.without_effect, known.tells) == (["b"], True)
    nothing = Information.by("a", np.ones(1), 1e-12 * ROWS[:, :1])
    assert (nothing.without_effect, nothing.tells) == (["a"], False)
    for columns, estimable in ((ROWS[:, :1], True), (1e-12 * ROWS[:, :1], False)):
        assert estimate_uncertainty(ROWS[:, 1], columns, 50).estimable.tolist() == [estimable]


def test_what_hardly_shows_is_named_with_its_error():
    columns = np.column_stack([ROWS[:, 0], ROWS[:, 1], ROWS[:, 1] + 1e-3 * ROWS[:, 2], ROWS[:, 3]])
    (group, error), *others = information(columns).nearly_null
    assert sorted(group) == ["b", "c"]
    assert others == []
    assert error > 50


def test_what_is_bad_by_what_is_granted_alone_is_named():
    """Noise tells all three to 0.2 or so; a gain moves the first as one of its own columns does."""
    columns = ROWS[:, :3]
    known = Information(("a", "b", "c"), np.ones(3), columns, 0.8 * columns[:, :1])
    assert known.granted == {"a": pytest.approx(0.8, rel=0.1)}
    assert known.sentences == [
        f"a is known to {100 * known.errors['a']:.0f} % only, by what gains of sensors and tolerances leave open: know "
        "these better"
    ]
    assert information(columns).granted == {}


def test_more_rows_add_their_information():
    both = information(ROWS[:25, :3]).with_more(ROWS[25:, :3])
    assert list(both.errors.values()) == pytest.approx(list(information(ROWS[:, :3]).errors.values()), rel=1e-9)


# -- of an actuator ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def task():
    return plan_task(vgtjax.Actuator(), [bench(0)], free=FREE)


def test_expected_errors_are_those_that_the_fit_claims(task):
    known, fitted = examine(task), calibrate(task)
    claimed = fitted.std_errors / np.abs(fitted.values)
    # A tenth: the fit estimates the noise by what remains.
    assert list(known.errors.values()) == pytest.approx(claimed.tolist(), rel=0.1)


@pytest.mark.parametrize(
    "granted",
    [
        {"gains": {"x_d": 0.01, "p_act": 0.005}},
        {"deviations": {"diaphragm.area": 5e-5}},
        {"deviations": {"diaphragm.area": 5e-5, "converter.plunger_mass": 1e-4}},
        {
            "deviations": {"diaphragm.damping": 2.0},
            "values": {"diaphragm.damping": 20.0, "friction.viscous_damping": 186.0},
            "free": [*FREE, "diaphragm.damping", "friction.viscous_damping"],
        },
    ],
    ids=[
        "gains of sensors",
        "a tolerance of what is held",
        "tolerances against the order of the table",
        "a value known beforehand",
    ],
)
def test_what_is_taken_for_granted_is_part_of_expected_errors(granted):
    planned = plan_task(vgtjax.Actuator(), [bench(0)], **{"free": FREE, **granted})
    known, fitted = examine(planned), calibrate(planned)
    claimed = fitted.std_errors / np.abs(fitted.values)
    noise = dict(zip(known.entries, known.solved.std_errors, strict=True))
    # A tenth as above: the fit estimates the noise by what remains, and its values are others.
    assert list(known.errors.values()) == pytest.approx(claimed.tolist(), rel=0.1)
    if "free" in granted:
        # Only the sum of both shows, to 0.2 N s/m or so, and one of them is known to 2.
        assert known.null == []
        for name, value in granted["values"].items():
            assert known.errors[name] * value == pytest.approx(2.0, rel=0.05)
        return
    assert any(known.errors[name] > 10 * noise[name] for name in noise)
    # Another run makes none of this better, and noise was small beside it: moved values trade among each other.
    (gain,) = next_runs(planned, known, STANDARD_RUNS[:1])
    assert sum(gain.after.values()) > 0.5 * sum(known.errors.values())


@pytest.mark.parametrize("kind", ["ramp", "step"])
def test_a_run_tells_the_same_beside_a_longer_one(task, kind):
    """It was taken for the beginning of that, which only random levels are."""
    known, short = examine(task), StandardRun(kind, 1.0, 100.0)
    (alone,) = next_runs(task, known, [short])
    beside = next(gain for gain in next_runs(task, known, [short, StandardRun(kind, 2.0, 100.0)]) if gain.run == short)
    # Side by side lanes are simulated in other segments.
    assert list(beside.after.values()) == pytest.approx(list(alone.after.values()), rel=1e-3)


def test_a_run_has_its_own_number_of_samples_beside_one_whose_rate_its_own_does_not_divide(task):
    """At 400 Hz beside 1 kHz every second sample was counted, 500 of a second."""
    known, slow = examine(task), StandardRun("levels", 1.0, 400.0)
    (alone,) = next_runs(task, known, [slow])
    beside = next(
        gain for gain in next_runs(task, known, [slow, StandardRun("levels", 1.0, 1000.0)]) if gain.run == slow
    )
    # By the same samples to half a millisecond, and a duty that is held for as long; errors would be 11 % smaller.
    assert list(beside.after.values()) == pytest.approx(list(alone.after.values()), rel=0.03)


def test_a_run_is_named_only_for_what_it_would_determine():
    """What no standard run feels either, and what one would tell, but badly."""
    known = Information(("a", "b"), np.ones(2), np.array([[1.0, 0.0]]))
    run = STANDARD_RUNS[0]
    assert remedies(known, [Gain(run, 1.0, {}, {"a": 0.9, "b": 10.0})]) == []
    assert remedies(known, [Gain(run, 1.0, {}, {"a": 0.9, "b": 0.04})]) == [
        f"a run of {run.label} would determine b to 4 %"
    ]


def test_area_damping_and_plunger_scale_are_named():
    """The scalings under which the equations of the actuator don't change (the whole, the plunger, a sum)."""
    free = ["diaphragm.area", "diaphragm.damping", "converter.plunger_mass", "diaphragm.*", "friction.*"]
    free += ["chamber.*", "converter.*stiffness", "converter.plunger_damping", "converter.*orifice*"]
    null = examine(plan_task(vgtjax.Actuator(), [bench(0)], free=free)).null
    assert ["diaphragm.damping", "friction.viscous_damping"] in null
    (whole,) = [group for group in null if "diaphragm.area" in group]
    assert {"chamber.volume", "diaphragm.mass", "diaphragm.stiffness", "friction.coulomb_force"} <= set(whole)
    assert "diaphragm.travel" not in whole


def test_the_scales_of_the_plunger_are_named():
    """Forces on it have one scale, with its inertia; and it moves as far as its orifices make of that."""
    null = examine(plan_task(vgtjax.Actuator(), [bench(0)], free=["converter.*"])).null
    with_mass = [set(group) for group in null if "converter.plunger_mass" in group]
    force = {"membrane_stiffness", "return_spring_stiffness", "plunger_damping", "actuator_area", "magnetic_force[2]"}
    travel = {"membrane_stiffness", "return_spring_stiffness", "plunger_damping", "reservoir_orifice_slope"}
    for scale in (force, travel):
        assert any({f"converter.{name}" for name in scale} <= group for group in with_mass)


def test_a_slow_loop_alone_calls_for_a_lively_run():
    """Mass and damping hardly move a rod that follows the pressure."""
    free = ["diaphragm.mass", "diaphragm.stiffness", "friction.viscous_damping", "friction.bristle_damping"]
    loop = sharp_bench(6, StandardRun("slow loop", 30.0, 100.0).trace(reservoir=2.0e4))
    task = plan_task(vgtjax.Actuator(), [loop], free=free)
    known = examine(task)
    assert known.errors["diaphragm.stiffness"] < 1e-3
    assert known.errors["diaphragm.mass"] > 1
    (said,) = remedies(known, next_runs(task, known))
    assert said.startswith(("a run of levels, ", "a run of step, "))
    assert "diaphragm.mass to" in said
    assert "friction.bristle_damping to" in said
    assert "diaphragm.stiffness" not in said


def test_the_run_that_helps_does_so_by_the_factor_that_it_says(task):
    known = examine(task)
    gains = next_runs(task, known, STANDARD_RUNS[:2])
    assert gains[0].factor >= gains[1].factor > 1
    best = gains[0].run
    inputs = best.trace(reservoir=2.0e4)
    run = vgtjax.simulate(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH), inputs)
    noise = {name: np.random.default_rng(5).normal(0, size, len(inputs.time)) for name, size in NOISE.items()}
    more = inputs.replace(x_d=np.asarray(run.x_d) + noise["x_d"], p_act=np.asarray(run.p_act) + noise["p_act"])
    before, after = calibrate(task), calibrate(plan_task(vgtjax.Actuator(), [bench(0), more], free=FREE))
    fell = dict(zip(task.selection.entries, before.std_errors / after.std_errors, strict=True))
    for name, (old, new) in gains[0].lowers.items():
        assert fell[name] == pytest.approx(old / new, rel=0.2)  # values differ by their errors


THIRD = 4 / 3
"""What expected and claimed errors may differ by: values, noise and its colour are estimated, corrections scatter."""


def test_a_fit_that_finds_out_all_the_rest_claims_what_was_expected_and_gains_by_the_run_ranked_first():
    """Of a plant that is not smoothed, from a start that is not the truth, with nothing said of noise and duty."""
    trace = sharp_bench(4)
    task = plan_fit(vgtjax.Actuator(), [trace], free=FREE)
    known, before = examine(task), calibrate(task)
    claimed = dict(zip(task.selection.entries, before.std_errors / np.abs(before.values), strict=True))
    for name, expected in known.errors.items():
        assert 1 / THIRD < claimed[name] / expected < THIRD, name
    best = next_runs(task, known, [run for run in STANDARD_RUNS if run.rate == 1000.0])[0]
    more = sharp_bench(5, best.run.trace(reservoir=2.0e4))
    after = calibrate(plan_fit(vgtjax.Actuator(), [trace, more], free=FREE))
    fell = dict(zip(task.selection.entries, before.std_errors / after.std_errors, strict=True))
    assert max(old / new for old, new in best.lowers.values()) > 2
    for name, (old, new) in best.lowers.items():
        assert 1 / THIRD < fell[name] / (old / new) < THIRD, name


def test_a_model_without_duty_has_no_next_run(task):
    half = vgtjax.MechanicalActuator()
    trace = bench(0).replace(pwm=None)
    mechanical = plan_task(half, [trace], free=["diaphragm.stiffness"])
    assert next_runs(mechanical, examine(mechanical)) == []


@pytest.mark.parametrize("run", STANDARD_RUNS, ids=lambda run: run.label)
def test_a_standard_run_can_be_asked_for(run):
    trace = run.trace()
    assert len(trace.time) == round(run.seconds * run.rate)
    assert np.diff(trace.time) == pytest.approx(1 / run.rate)
    assert trace.pwm is not None
    assert (trace.pwm[0], trace.pwm.min(), trace.pwm.max() > 50) == (0.0, 0.0, True)
    assert trace.pwm.max() <= 100


def test_a_loop_with_gas_says_its_pressure():
    loop = StandardRun("slow loop", 30.0, 100.0, 1.5e5)
    assert loop.label == "slow loop at 1500 mbar, 30 s at 100 Hz"
    np.testing.assert_array_equal(loop.trace().p_trb, 1.5e5)
