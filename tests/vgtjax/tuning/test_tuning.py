"""Tuning through the gradient: the cost of closed loops, its derivatives, and the steps of the optimiser."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import RESULTS, control
from vgtjax.control import PI, PID, Constant, FrictionCompensation, Knocker, Sine
from vgtjax.simulation import choose
from vgtjax.tuning import (
    STEEPEST,
    Objective,
    Tuner,
    cross_cases,
    gain_names,
    plan_tuning,
    soften,
    soften_cases,
    tune,
)
from vgtjax.tuning._quadratic import QuadraticModel, model_at
from vgtjax.tuning._remembered import APART, WILD, linearise_remembered, shaking
from vgtjax.tuning._tuner import BATCHES, LENGTHS, SLACK, STALL

SECONDS, SETTLED = 0.6, 0.2
"""Long enough for a controller to matter, short enough for many tests."""
REFERENCES = {"sine": Sine(0.003, 15.0, 0.005), "hold": Constant(0.004)}
"""The first is so fast that a stiff controller's duty saturates."""
OBJECTIVE = Objective(tracking=1e-4, effort=200.0, chatter=1.0, largest_error=2e-4, settled=SETTLED)
LANES = 4
"""As many as there are cases: what is compiled for one place serves the trials of a search too."""


def pi(actuator):
    return PI(base=control.StaticBalance(actuator.converter, actuator.diaphragm))


@pytest.fixture(scope="module")
def cases(actuator):
    weak = vgtjax.replace_parameters(actuator, {"diaphragm.stiffness": 11_800.0})
    plants = {"printed": actuator, "weak": weak}
    return soften_cases(cross_cases(plants, REFERENCES, duration=SECONDS))


@pytest.fixture(scope="module")
def problem(actuator, cases):
    return plan_tuning(pi(actuator), cases, OBJECTIVE, lanes=LANES)


@pytest.fixture(scope="module")
def tuned(problem):
    tuner = Tuner(problem)
    progress = [tuner.progress]
    while not tuner.progress.finished:
        progress.append(tuner.step())
    return progress


def test_the_cost_is_what_the_objective_says(problem):
    """Written once more, with numpy, from the runs."""
    runs = problem.simulate(problem.start, range(4))
    late = np.asarray(runs.time[0]) >= SETTLED
    error, duty = np.asarray(runs.error)[:, late], np.asarray(runs.duty)
    change = np.diff(duty, axis=1)[:, late[1:]]
    beyond = np.maximum(np.abs(error) - 2e-4, 0)
    terms = [(error / 1e-4) ** 2, (duty[:, late] / 200) ** 2, change**2, 10 * (beyond / 1e-4) ** 2]
    expected = np.stack([term.mean(1) for term in terms], 1)
    found = problem.evaluate(problem.start)
    # The same sums in another order.
    np.testing.assert_allclose(found.terms, expected, rtol=1e-9)
    assert np.all(expected.max(0) > 0), "a term that is zero here is not tested"
    np.testing.assert_allclose(found.rms, np.sqrt((error**2).mean(1)), rtol=1e-9)
    np.testing.assert_allclose(found.peak, np.abs(error).max(1), rtol=1e-12)
    costs = expected.sum(1)
    whole = 0.5 * costs.mean() + 0.5 * (costs**8).mean() ** (1 / 8)
    assert problem.cost(problem.start) == pytest.approx(whole, rel=1e-9)


def stiff(actuator):
    return dataclasses.replace(pi(actuator), proportional_gain=60_000.0)


CONTROLLERS = {
    "pid": lambda a: PID(stiff(a)),
    "knocker": lambda a: soften(Knocker(stiff(a))),
    "friction-compensation": lambda a: FrictionCompensation(converter=a.converter, diaphragm=a.diaphragm),
}


@pytest.mark.parametrize("name", CONTROLLERS)
def test_slopes_with_respect_to_every_gain_are_those_of_central_differences(name, actuator, cases):
    """With noise and friction; the loops are those that are tuned."""
    problem = plan_tuning(CONTROLLERS[name](actuator), cases, OBJECTIVE, lanes=LANES)
    found = problem.linearise(problem.start)
    step = 1e-5
    differences = [
        (problem.evaluate(problem.start + d).costs - problem.evaluate(problem.start - d).costs) / (2 * step)
        for d in step * np.eye(len(problem.start))
    ]
    differences = np.stack(differences, 1)
    # 1e-8 where no sample crosses a kink (plunger, reversal, limit); one that does is off by its share of all.
    scale = np.linalg.norm(differences, axis=0)
    assert np.all(scale > 0)
    np.testing.assert_array_less(np.linalg.norm(found.slopes - differences, axis=0), 1e-3 * scale)


def test_the_curvature_is_twice_the_gram_matrix_of_the_residuals(problem):
    """Residuals' columns by central differences of single runs."""
    columns, step = [], 1e-5
    for direction in np.eye(len(problem.start)):
        ends = [problem.simulate(problem.start + side * step * direction, range(4)) for side in (1, -1)]
        upper, lower = (OBJECTIVE.residuals(jax.tree.map(lambda leaf: leaf[0], end)) for end in ends)
        columns.append(np.ravel(upper - lower) / (2 * step))
    gram = 2 * np.array(columns) @ np.array(columns).T
    found = problem.linearise(problem.start).curvatures[0]
    np.testing.assert_allclose(found, gram, rtol=5e-3, atol=5e-3 * np.abs(gram).max())


def test_tuning_lowers_the_cost_within_bounds_and_says_how_it_ended(actuator, cases, problem, tuned):
    last = tuned[-1]
    assert last.converged
    assert last.verdict
    # The default gains are loose: an order of magnitude is there to be gained.
    assert last.cost < 0.1 * last.history[0]
    assert all(later <= earlier for earlier, later in zip(last.history, last.history[1:], strict=False))
    assert problem.cost(np.asarray(last.coordinates)) == pytest.approx(last.cost, rel=1e-9)
    bounds = {"proportional_gain": (None, 9000.0), "integral_gain": (19_000.0, None)}
    held = plan_tuning(pi(actuator), cases, OBJECTIVE, bounds=bounds, fixed=["tracking_time"])
    assert held.selection.entries == ("proportional_gain", "integral_gain")
    tuner = Tuner(held)
    while not tuner.progress.finished:
        tuner.step()
    gains = held.controller_at(np.asarray(tuner.progress.coordinates))
    assert float(gains.proportional_gain) == pytest.approx(9000.0)
    # The exponential of a logarithm rounds.
    assert float(gains.integral_gain) >= 19_000.0 * (1 - 1e-12)
    assert float(gains.tracking_time) == 0.1


def test_one_call_tunes_the_softened_loops_and_returns_the_controller_as_it_is(actuator, cases):
    knocker = Knocker(pi(actuator))
    limit = 14_000.0
    bounds = {"controller.proportional_gain": (None, limit)}
    tuned, progress = tune(knocker, cases, OBJECTIVE, bounds=bounds, memories=[np.inf], lanes=LANES)
    assert progress.converged
    assert progress.cost < progress.history[0]
    assert float(tuned.sign_width) == float(knocker.sign_width)
    place = gain_names(knocker).index("controller.proportional_gain")
    assert float(tuned.controller.proportional_gain) <= limit * (1 + 1e-12)
    assert float(tuned.controller.proportional_gain) == pytest.approx(np.exp(progress.coordinates[place]), rel=1e-12)


def test_tuning_that_was_interrupted_goes_on_as_if_it_had_not_been(problem, tuned):
    place = 3
    resumed = Tuner(problem, tuned[place])
    assert resumed.progress == tuned[place]
    again = resumed.step()
    assert again.coordinates == pytest.approx(tuned[place + 1].coordinates, rel=1e-9)
    assert again.history == pytest.approx(tuned[place + 1].history, rel=1e-9)


def _as(problem, kind):
    """The same fields in a class of the test."""
    return kind(**{field.name: getattr(problem, field.name) for field in dataclasses.fields(problem)})


def _failing(problem, when):
    """The problem, whose closed loops fail `when` coordinates say so."""

    def broken(cases):
        bad = np.array([True, False, False, False])
        result = jax.vmap(lambda bad, end: choose(bad, RESULTS.diverged, end))(bad, cases.result)
        return dataclasses.replace(cases, terms=np.where(bad[:, None], np.nan, cases.terms), result=result)

    class Failing(type(problem)):
        def evaluate_all(self, candidates):
            found = zip(candidates, super().evaluate_all(candidates), strict=True)
            return [broken(cases) if when(at) else cases for at, cases in found]

        def linearise(self, coordinates, memory=np.inf):
            found = super().linearise(coordinates, memory)
            return dataclasses.replace(found, cases=broken(found.cases)) if when(coordinates) else found

    return _as(problem, Failing)


def test_a_trial_at_which_a_closed_loop_fails_is_never_taken(problem):
    start = problem.start
    tuner = Tuner(_failing(problem, lambda at: not np.array_equal(at, start)))
    progress = tuner.step()
    assert progress.coordinates == tuple(start)
    assert progress.failed == progress.trials > 0
    assert set(progress.history) == {progress.cost}
    assert set(progress.costs[1:]) == {None}
    # Nor by costs alone, which know of it that it is bad.
    progress = tuner.step()
    assert progress.kinds == (False, True)
    assert progress.coordinates == tuple(start)
    assert progress.failed == progress.trials


def _dearer(problem, factor):
    """The problem, where every place that is tried costs as much as the start, times a factor."""

    class Dearer(type(problem)):
        def evaluate_all(self, candidates):
            found = super().evaluate_all(np.broadcast_to(problem.start, candidates.shape))
            factors = [1.0 if np.array_equal(at, problem.start) else factor for at in candidates]
            return [dataclasses.replace(c, terms=c.terms * f) for c, f in zip(found, factors, strict=True)]

        def linearise(self, coordinates, memory=np.inf):
            return super().linearise(problem.start, memory)

    return _as(problem, Dearer)


def test_tuning_that_stalls_asks_both_kinds_of_steps_before_it_ends(problem):
    """Where neither kind gains, costs alone are asked twice as often: they take longer to learn something."""
    tuner = Tuner(_dearer(problem, 1.0))
    while not tuner.progress.finished:
        stalled = tuner.step()
    assert stalled.converged
    assert stalled.kinds == (False, True, True, False, True, True)
    assert stalled.iteration == STALL
    assert set(stalled.history) == {stalled.cost}
    assert stalled.coordinates == tuple(problem.start)
    assert stalled.trials == (2 + 4 * BATCHES) * len(LENGTHS)


def test_after_a_step_without_success_memories_are_others_and_the_best_is_the_start(problem):
    tuner = Tuner(_dearer(problem, 1 + 2 * SLACK))
    before, after = tuner.progress, tuner.step()
    assert after.here == after.coordinates == tuple(problem.start)
    assert set(after.memories) in ({0}, {len(problem.memories) - 2})
    assert set(after.memories) != set(before.memories)


@pytest.mark.parametrize(("factor", "goes"), [(1 + 0.5 * SLACK, True), (1 + 2 * SLACK, False)])
def test_a_step_may_cost_a_little_but_the_best_is_kept(problem, factor, goes):
    tuner = Tuner(_dearer(problem, factor))
    progress = tuner.step()
    assert (progress.here != tuple(problem.start)) == goes
    assert progress.coordinates == tuple(problem.start)
    assert set(progress.history) == {tuner.problem.combine(tuner.cases.costs)}


def test_a_proposal_is_the_lowest_point_within_its_radius(problem):
    """A gain that matters little moves little: the distance is not scaled by the curvature."""
    slope, curvature = np.array([-3.0, 0.4, 0.0]), np.diag([2.0, 2.0, 1e-6])
    model = QuadraticModel(problem.start, 5.0, 5.0 * slope, 5.0 * curvature)
    # Newton's step where it is near enough; SLSQP ends at 1e-10 of the model, a root of that in the step.
    np.testing.assert_allclose(model.propose(problem, 2.0) - problem.start, [1.5, -0.2, 0.0], atol=1e-4)
    near = model.propose(problem, 0.3) - problem.start
    assert np.linalg.norm(near) == pytest.approx(0.3, rel=1e-6)
    # Of all points of a sphere the lowest has its gradient along the step (Lagrange).
    gradient = slope + curvature @ near
    np.testing.assert_allclose(-gradient / np.linalg.norm(gradient), near / 0.3, atol=1e-4)


def test_curvatures_beyond_belief_are_cut(problem):
    at = problem.linearise(problem.start)
    steep = dataclasses.replace(at, curvatures=1e9 * at.curvatures)
    weights, _ = problem.objective.derivatives(at.cases.costs)
    highest = [np.linalg.eigvalsh(model_at(problem, problem.start, each).curvature)[-1] for each in (at, steep)]
    bend = np.linalg.eigvalsh(at.slopes.T @ problem.objective.derivatives(at.cases.costs)[1] @ at.slopes)[-1]
    assert max(highest) <= STEEPEST * weights @ at.cases.costs + bend
    assert highest[1] >= highest[0] * (1 - 1e-12)


def test_a_start_whose_closed_loops_fail_is_named(problem):
    sentence = r"1 closed loops fail .* 'printed, sine, 0 mbar'; .* The simulation left"
    with pytest.raises(vgtjax.SimulationError, match=sentence):
        Tuner(_failing(problem, lambda at: True))


class _Remembering:
    """Mixed into a problem: spoils what loops with some memory find."""

    spoil = None

    def linearise(self, coordinates, memory=np.inf):
        found = super().linearise(coordinates, memory)
        return self.spoil(found, np.broadcast_to(memory, len(self.cases)))


def _spoiled(problem, how, memories):
    kind = type("Spoiled", (_Remembering, type(problem)), {"spoil": staticmethod(how)})
    return _as(dataclasses.replace(problem, memories=memories), kind)


def test_derivatives_that_overflow_are_not_used(problem):
    def overflow(found, memory):
        return dataclasses.replace(found, slopes=np.where(memory[:, None] < 1, found.slopes, np.inf))

    tuner = Tuner(_spoiled(problem, overflow, (np.inf, 2.0, 1.0, 0.1)))
    assert tuner.progress.memories == (2, 2, 2, 2)
    assert tuner.step().memories == (3, 3, 3, 3)
    assert tuner.progress.cost < tuner.progress.history[0]
    only = Tuner(_spoiled(problem, overflow, (np.inf,)))
    assert only.step().finished
    assert not only.progress.converged


def test_only_a_loop_whose_derivatives_shake_gets_a_shorter_memory(problem):
    """The slopes are then those that each loop has with its own memory."""

    def shake(found, memory):
        wild = (memory >= 1) & (np.arange(len(memory)) == 2)
        return dataclasses.replace(found, curvatures=found.curvatures * np.where(wild, 1e12, 1.0)[:, None, None])

    shaken = _spoiled(problem, shake, (np.inf, 1.0, 0.1))
    found, memories, asked = linearise_remembered(shaken, problem.start, np.zeros(4, int))
    assert asked == 2
    exact, short = (problem.linearise(problem.start, memory) for memory in (np.inf, 0.1))
    assert memories[[0, 1, 3]].tolist() == [0, 0, 0]
    for name in ("slopes", "curvatures"):
        np.testing.assert_allclose(np.delete(getattr(found, name), 2, 0), np.delete(getattr(exact, name), 2, 0))
        np.testing.assert_allclose(getattr(found, name)[2], getattr(short, name)[2])
    assert np.any(short.slopes[2] != exact.slopes[2])
    assert memories[2] == 2
    # Calm there, it tries the next longer one again.
    assert linearise_remembered(shaken, problem.start, memories)[1][2] == 1


def test_slopes_of_a_wild_loop_count_for_less(problem):
    """With one memory only, and an error of ten times what is wild."""
    at = problem.linearise(problem.start)
    error = shaking(problem, at)
    factors = (10 * WILD / error) ** 2 * np.array([0.0, 0.0, 1.0, 0.0]) + np.array([1.0, 1.0, 0.0, 1.0])

    def shake(found, memory):
        return dataclasses.replace(found, curvatures=found.curvatures * factors[:, None, None])

    found, *_ = linearise_remembered(_spoiled(problem, shake, (np.inf,)), problem.start, np.zeros(4, int))
    expected = at.slopes * np.minimum(1.0, (WILD / error) ** 2)[:, None]
    expected[2] = at.slopes[2] / 100
    np.testing.assert_allclose(found.slopes, expected, rtol=1e-6)


def test_shaking_is_the_standard_error_of_a_slope_that_chance_made(problem):
    """Residuals of tracking and derivatives that have nothing to do with each other, one of each in `APART`."""
    rng, count = np.random.default_rng(0), round((problem.cases.duration - SETTLED) / APART)
    residuals = rng.normal(size=(4000, count)) / np.sqrt(count)
    columns = rng.normal(size=(4000, count))
    slopes, costs = 2 * np.sum(residuals * columns, 1), np.sum(residuals**2, 1)
    gains = len(problem.start)
    curvature = np.mean(2 * np.sum(columns**2, 1)) * np.ones((4, gains, gains))
    terms = np.mean(costs) * np.array([[1.0, 0.0, 0.0, 0.0]] * 4)
    at = dataclasses.replace(problem.linearise(problem.start), curvatures=curvature)
    at = dataclasses.replace(at, cases=dataclasses.replace(at.cases, terms=terms))
    # The standard error of a standard deviation of 4000 is 1.1 %.
    np.testing.assert_allclose(shaking(problem, at), np.std(slopes) / np.mean(costs), rtol=0.04)


def test_a_loop_without_cost_does_not_shake(problem):
    at = problem.linearise(problem.start)
    nothing = dataclasses.replace(at.cases, terms=0 * at.cases.terms)
    still = dataclasses.replace(at, cases=nothing, slopes=0 * at.slopes, curvatures=0 * at.curvatures)
    np.testing.assert_array_equal(shaking(problem, still), 0.0)


def test_candidates_side_by_side_cost_what_each_costs_alone(problem):
    candidates = problem.start + np.array([[0.0], [0.1], [-0.2]])
    together = dataclasses.replace(problem, lanes=3 * LANES).evaluate_all(candidates)
    for at, found in zip(candidates, together, strict=True):
        np.testing.assert_allclose(found.terms, problem.evaluate(at).terms, rtol=1e-9)


def test_a_closed_loop_that_fails_is_not_a_number_and_spoils_no_other(problem):
    plants = eqx.tree_at(lambda p: p.diaphragm.mass, problem.cases.plants, jnp.asarray([0.63, jnp.nan, 0.63, 0.63]))
    broken = dataclasses.replace(problem, cases=dataclasses.replace(problem.cases, plants=plants))
    found, whole = broken.evaluate(problem.start), problem.evaluate(problem.start)
    assert found.failed.tolist() == [False, True, False, False]
    assert np.isnan(found.costs[1])
    np.testing.assert_allclose(np.delete(found.costs, 1), np.delete(whole.costs, 1), rtol=1e-9)
    assert broken.cost(problem.start) == np.inf


def test_steps_stay_inside_the_conditions_of_the_design(actuator, cases):
    """From a start at the edge, with a cost that wants to go through it."""
    start = dataclasses.replace(CONTROLLERS["friction-compensation"](actuator), derivative_gain=63.4)
    problem = plan_tuning(start, cases, Objective(tracking=1.0, chatter=0.01, settled=SETTLED), lanes=LANES)
    tuner, seen = Tuner(problem), []
    for _ in range(3):
        progress = tuner.step()
        seen.append(problem.conditions(np.asarray(progress.coordinates)).min())
        problem.controller_at(np.asarray(progress.coordinates))  # raises where the design does not hold
    assert min(seen) >= 0
    assert seen[0] < 1e-12, "the first step ends at the edge; later ones may come away from it"
    assert progress.cost <= progress.history[0]
