"""Estimation: noise, uncertainty against closed form and Monte Carlo, recovery from noisy data, rejected steps."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from known_truth import FREE, TRUTH, bench

import vgtjax
from vgtjax.estimation import (
    CHI2_TOLERANCE,
    VERDICTS,
    LevenbergMarquardt,
    Progress,
    calibrate,
    estimate_uncertainty,
    find_remains,
    least_squares,
    plan_task,
    run_alone,
    start_calibration,
)
from vgtjax.estimation._task import RUNAWAY
from vgtjax.estimation.search._point import Reduced
from vgtjax.parameters import build_transform
from vgtjax.traces import noise_level


def test_noise_is_read_off_a_moving_signal():
    rng = np.random.default_rng(3)
    moving = 5e-3 * np.sin(np.linspace(0, 20, 4000))
    assert noise_level(moving + rng.normal(0, 8e-6, 4000), "x_d") == pytest.approx(8e-6, rel=0.05)
    quantised = np.round(rng.normal(0, 8e-6, 4000) / 1e-6) * 1e-6
    assert noise_level(quantised, "x_d") == pytest.approx(8e-6, rel=0.06)
    assert noise_level(moving, "x_d") < 2e-7  # a clean record gets the floor, not an infinite weight
    assert noise_level(np.zeros(100), "p_act") == 1.0


@pytest.mark.parametrize("count", [2, 3, 5, 7])
def test_a_few_samples_do_not_look_like_a_sensor_without_noise(count):
    """The median over many records is right to a third, as that of so few numbers is not that of many."""
    records = np.random.default_rng(2).normal(0, 1e-3, (400, count))
    found = np.median([noise_level(each, "x_d") for each in records])
    assert found == pytest.approx(1e-3, rel=0.35)


@pytest.fixture(scope="module")
def fitted():
    return calibrate(plan_task(vgtjax.Actuator(), [bench(0)], [bench(1)], free=FREE))


def test_known_parameters_are_recovered_within_their_errors(fitted):
    assert fitted.progress.converged
    truth = np.array([TRUTH[entry] for entry in fitted.task.selection.entries])
    deviation = (fitted.values - truth) / fitted.std_errors
    assert np.all(np.abs(deviation) < 4)  # four standard errors
    assert fitted.progress.history[-1] < 0.01 * fitted.progress.history[0]


def test_what_remains_is_the_noise_and_offsets_are_found(fitted):
    for result in fitted.traces:
        assert result.rmse["x_d"] == pytest.approx(8e-6, rel=0.06)
        assert result.rmse["p_act"] == pytest.approx(60.0, rel=0.06)
        assert result.offset["x_d"] == pytest.approx(2e-5, abs=2e-6)
        assert result.offset["p_act"] == pytest.approx(-150.0, abs=15)
    assert fitted.uncertainty.scale == pytest.approx(1.0, abs=0.1)
    assert [result.use for result in fitted.traces] == ["fit", "validate"]


def test_standard_errors_cover_the_truth_as_often_as_they_claim(fitted):
    """Monte Carlo: the scatter of 30 fits of the same bench is what each of them claims, within its own error."""
    found, claimed = [], []
    for seed in range(30):
        run = calibrate(plan_task(vgtjax.Actuator(), [bench(100 + seed)], free=FREE))
        found.append(run.values)
        claimed.append(run.std_errors)
    # The deviation of 30 samples is known to 13 %; three of those.
    np.testing.assert_allclose(np.std(found, axis=0, ddof=1), np.mean(claimed, axis=0), rtol=0.4)
    truth = np.array([TRUTH[entry] for entry in fitted.task.selection.entries])
    inside = np.abs(np.array(found) - truth) < 1.96 * np.array(claimed)
    assert 0.85 <= inside.mean() <= 1.0  # 95 % of 90, four binomial deviations below


def test_uncertainty_of_a_straight_line_is_the_textbook_one():
    x = np.linspace(0, 1, 50)
    columns = np.stack([np.ones_like(x), x], axis=1)
    residuals = np.random.default_rng(0).normal(size=50)
    found = estimate_uncertainty(residuals, columns, 50)
    scale = residuals @ residuals / 48
    np.testing.assert_allclose(found.covariance, scale * np.linalg.inv(columns.T @ columns), rtol=1e-12)
    assert found.scale == pytest.approx(scale)
    drop = residuals @ residuals - np.sum((residuals - columns @ np.linalg.lstsq(columns, residuals)[0]) ** 2)
    assert found.gain == pytest.approx(drop)


def test_null_directions_make_exactly_their_parameters_not_determined():
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(200, 4)) * [1e3, 1.0, 1e-3, 1.0]  # units must not matter
    assert least_squares(columns, np.zeros(200)).estimable.tolist() == [True] * 4
    twins = np.column_stack([columns, 5 * columns[:, 1], np.zeros(200)])
    assert least_squares(twins, np.zeros(200)).estimable.tolist() == [True, False, True, True, False, False]


def test_a_null_direction_leaves_the_errors_of_the_others_as_they_are():
    rng = np.random.default_rng(0)
    first = rng.normal(size=300)
    second = 0.9 * first + 0.3 * rng.normal(size=300)
    residuals = rng.normal(size=300)
    alone = estimate_uncertainty(residuals, np.stack([first, second], axis=1), 300)
    twice = estimate_uncertainty(residuals, np.stack([first, first, second, 0 * first], axis=1), 300)
    assert twice.estimable.tolist() == [False, False, True, False]
    assert twice.covariance[2, 2] == pytest.approx(alone.covariance[1, 1], rel=1e-9)
    assert twice.scale == pytest.approx(alone.scale, rel=1e-12)
    assert np.all(twice.covariance[[0, 1, 3]] == 0)


def test_an_engineer_is_told_before_the_fit_what_the_traces_do_not_determine():
    """Of the two dampings only the sum acts (erratum), and the closed stop is never touched."""
    free = ["diaphragm.stiffness", "diaphragm.damping", "friction.viscous_damping", "diaphragm.travel"]
    values = {"diaphragm.damping": 1.0}  # off its bound, which alone would hold it
    calibrator = start_calibration(plan_task(vgtjax.Actuator(), [bench(0)], free=free, values=values))
    assert set(calibrator.not_estimable()) == {"diaphragm.damping", "friction.viscous_damping", "diaphragm.travel"}


def test_bounds_are_respected_and_reported():
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, bounds={"diaphragm.stiffness": (11000.0, 12210.0)})
    run = calibrate(task)
    index = run.task.selection.entries.index("diaphragm.stiffness")
    # The truth lies beyond. The value is no rounding error past its bound, as exp(log(12210)) is: none would read that.
    assert run.values[index] == 12210.0
    assert run.at_bound.tolist() == [i == index for i in range(3)]
    assert not np.isfinite(run.std_errors[index])
    held = calibrate(
        plan_task(
            vgtjax.Actuator(),
            [bench(0)],
            free=FREE,
            fixed=["diaphragm.stiffness"],
            values={"diaphragm.stiffness": 12210.0},
        )
    )
    others = np.arange(3) != index
    assert run.progress.converged
    assert run.progress.iteration < 20
    # On the bound, the others are where they are with that one held there, errors included.
    np.testing.assert_allclose(run.values[others], held.values, rtol=1e-6)
    np.testing.assert_allclose(run.std_errors[others], held.std_errors, rtol=1e-3)


@pytest.mark.parametrize(("logarithm", "named"), [(1.01, True), (0.99, False), (-1.01, True), (-0.99, False)])
def test_a_positive_value_that_ran_away_is_named(fitted, logarithm, named):
    """The preload, which may have either sign, has no start that it could leave by a factor."""
    assert fitted.ran_away == ()
    start = np.asarray(fitted.transform.to_coordinates(fitted.task.selection.pack(fitted.task.model)))
    moves = {"diaphragm.stiffness": logarithm * np.log(RUNAWAY), "diaphragm.preload": 1e9}
    moved = start + [moves.get(entry, 0.0) for entry in fitted.task.selection.entries]
    gone = dataclasses.replace(fitted, progress=dataclasses.replace(fitted.progress, coordinates=tuple(moved)))
    assert gone.ran_away == (("diaphragm.stiffness",) if named else ())
    bounded = dataclasses.replace(gone, transform=dataclasses.replace(gone.transform, lower=moved, upper=moved))
    assert bounded.ran_away == ()  # whoever sets a bound so far off means it


def test_a_trial_whose_simulation_fails_is_rejected_and_shortened(monkeypatch):
    """From a start far off, with a step so long that the chamber's volume would vanish."""
    values = {**TRUTH, "chamber.volume": 3.2e-5}
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=["chamber.volume"], values=values)
    problem = start_calibration(task).minimiser.problem
    transform = build_transform(vgtjax.parameter_table(task.model), ["chamber.volume"], np.array([3.2e-5]), {})
    broken = float(transform.to_coordinates(jnp.asarray([1e-6]))[0])
    assert not np.any(np.isfinite(problem.residuals(jnp.asarray([broken]))))  # never zero, never NaN
    start = tuple(np.asarray(transform.to_coordinates(jnp.asarray([3.2e-5]))).tolist())
    far = Progress(start, longest=np.inf)
    minimiser = run_alone(LevenbergMarquardt.begin(problem, far))
    usual, asked = Reduced.damped_steps, []

    def too_far_at_first(self, sizes):
        asked.append(sizes)
        return usual(self, sizes) if len(asked) > 1 else np.full((len(sizes), 1), broken - far.coordinates[0])

    monkeypatch.setattr(Reduced, "damped_steps", too_far_at_first)
    progress = minimiser.step()
    assert (progress.failed, progress.rejected, progress.accepted) == (len(asked[0]), 1, 1)
    assert progress.cost < progress.history[0]
    assert max(asked[1]) < min(asked[0])
    monkeypatch.setattr(
        Reduced, "damped_steps", lambda self, sizes: np.full((len(sizes), 1), broken - far.coordinates[0])
    )
    stuck = run_alone(LevenbergMarquardt.begin(problem, far)).step()
    assert (stuck.cost, stuck.coordinates) == (stuck.history[0], far.coordinates)
    assert stuck.finished
    assert "no trial of the last step lowered the cost" in stuck.verdict
    monkeypatch.undo()
    while not progress.finished:
        progress = minimiser.step()
    assert progress.converged
    assert transform.to_physical(jnp.asarray(progress.coordinates))[0] == pytest.approx(57e-6, rel=0.02)


def test_a_start_that_fails_says_so():
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=["chamber.volume"], values={"chamber.volume": 1e-6})
    with pytest.raises(vgtjax.SimulationError, match="simulation with the start values fails"):
        start_calibration(task)


def test_an_interrupted_fit_goes_on_exactly_where_it_was(fitted):
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=FREE)
    first = start_calibration(task).minimiser
    first.step()
    saved = Progress(**dataclasses.asdict(first.step()))
    rest = start_calibration(task, saved).minimiser
    while not rest.progress.finished:
        rest.step()
    assert rest.progress == fitted.progress


def test_residuals_carry_the_segment_parallel_jacobian():
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=FREE)
    problem = start_calibration(task).minimiser.problem
    start = problem.transform.to_coordinates(problem.selection.pack(problem.model))
    tangent = jnp.asarray([0.3, -0.2, 0.5])
    values, pushed = jax.jvp(problem.residuals, (start,), (tangent,))
    h = 1e-5
    difference = (problem.residuals(start + h * tangent) - problem.residuals(start - h * tangent)) / (2 * h)
    # 1e-4 of the norm: a kink of the friction that moves over a sample.
    assert np.linalg.norm(pushed - difference) < 1e-4 * np.linalg.norm(difference)
    assert 0.5 * float(values @ values) > 1


def test_converged_means_that_another_step_gains_nothing(fitted):
    assert fitted.uncertainty.gain < CHI2_TOLERANCE


def test_a_trace_with_one_channel_is_fitted_on_it():
    both = bench(0)
    run = calibrate(plan_task(vgtjax.Actuator(), [both.replace(x_d=None)], free=["chamber.volume"]))
    assert set(run.traces[0].rmse) == {"p_act"}
    assert run.progress.converged


def test_a_fit_in_single_precision_is_refused():
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), vgtjax.Actuator())
    with pytest.raises(vgtjax.InputError, match="a fit needs double precision"):
        start_calibration(plan_task(single, [bench(0)], free=FREE))


def test_a_fit_without_traces_is_refused():
    with pytest.raises(vgtjax.InputError, match="at least one trace, but there is none; give one"):
        plan_task(vgtjax.Actuator(), [])


def test_a_fit_that_kinks_hold_up_stops(monkeypatch):
    """A step that gains next to nothing ends a fit, but only after it has found its feet."""
    ended = start_calibration(plan_task(vgtjax.Actuator(), [bench(1)], free=["chamber.volume"])).minimiser
    while not ended.progress.converged:
        ended.step()
    near = dataclasses.replace(ended.progress, converged=False)
    monkeypatch.setattr(
        "vgtjax.estimation.search._search.CHI2_TOLERANCE", 0.0
    )  # what a linear step promises never ends it
    again = run_alone(LevenbergMarquardt.begin(ended.problem, near)).step()
    assert again.converged
    assert again.stalled
    assert "all trials of the last step lowered chi^2 by less than 0.1" in again.verdict
    fresh = run_alone(LevenbergMarquardt.begin(ended.problem, dataclasses.replace(near, accepted=0)))
    assert not fresh.step().stalled


def test_a_second_fit_of_equal_shapes_compiles_nothing(caplog):
    """What a fleet gains: one compilation for twenty actuators."""
    first, second = (plan_task(vgtjax.Actuator(), [bench(seed)], free=FREE) for seed in (1, 2))
    start_calibration(first).minimiser.step()
    with jax.log_compiles():
        start_calibration(second).minimiser.step()
        assert not [record for record in caplog.records if "observe" in record.getMessage()]
        jax.clear_caches()  # what other tests compiled too, so this one is the last
        start_calibration(second).minimiser.step()
    assert [record for record in caplog.records if "observe" in record.getMessage()], "the log tells of compilations"


def test_a_sensor_with_one_valid_sample_breaks_nothing(fitted):
    whole = bench(0)
    once = np.arange(len(whole.time)) == 700
    trace = whole.replace(p_act=vgtjax.Channel(whole.time, whole.p_act, once))
    assert (whole.has_pairs, trace.has_pairs) == (True, False)
    found = calibrate(plan_task(vgtjax.Actuator(), [trace], free=FREE))
    over_time = {each.channel: each for each in find_remains(found) if each.over == "time"}
    assert (over_time["p_act"].p, over_time["p_act"].verdict) == (1.0, VERDICTS[0])
    # The position alone tells the spring as well as it did.
    place = found.task.selection.entries.index("diaphragm.stiffness")
    assert found.std_errors[place] == pytest.approx(fitted.std_errors[place], rel=0.5)


def test_traces_of_one_name_are_told_apart():
    same, other = bench(0), bench(1).replace(name="other")
    task = plan_task(vgtjax.Actuator(), [same, other, bench(1)], [bench(2)], free=FREE)
    names = [trace.name for trace in (*task.fit, *task.validate)]
    assert names == [f"{same.name} 1", "other", f"{same.name} 2", f"{same.name} 3"]
