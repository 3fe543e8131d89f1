"""The search by costs alone: a surrogate of them, candidates that it hopes for, and a valley that derivatives miss."""

import dataclasses
import json

import jax
import numpy as np
import pytest
import scipy.optimize

from vgtjax import RESULTS
from vgtjax.control import PI, Constant
from vgtjax.tuning import (
    CaseCosts,
    Linearisation,
    Objective,
    Tuner,
    TuningProblem,
    TuningProgress,
    _scatter,
    cross_cases,
    plan_tuning,
)
from vgtjax.tuning._quadratic import QuadraticModel, model_at
from vgtjax.tuning._scatter import BOLDNESS, scatter
from vgtjax.tuning._surrogate import ROUGH, _improbability, fit_surrogate

GOOD = jax.tree.map(lambda value: np.zeros(2, value.dtype), RESULTS.successful)
"""Two loops that ended well."""
EDGE = 1.0
"""Of the region where the loops of the analytic problem are stable."""


class Cliff(TuningProblem):
    """Loops whose error falls with the first gain, and which hunt where the first two together are too high.

    Derivatives see the error and nothing of the hunting, as those with a short memory: of all residuals but one.
    """

    @property
    def start(self):
        return np.array([0.0, 0.5, 0.0])

    def residuals(self, at):
        hunting = np.maximum(at[1] + 0.5 * at[0] - EDGE - 0.3 * at[2], 0.0)
        error, noise = np.exp(-at[0]), np.exp(0.3 * at[0])
        smooth = [[(10 - i) * error, 0.2 * noise, 0.3 * np.exp(-at[1]), 0.1 * at[2]] for i in range(len(self.cases))]
        return np.array([[*row, (8 - i) * hunting] for i, row in enumerate(smooth)])

    def columns(self, at):
        error, noise = np.exp(-at[0]), np.exp(0.3 * at[0])
        return np.array(
            [
                [[(i - 10) * error, 0, 0], [0.06 * noise, 0, 0], [0, -0.3 * np.exp(-at[1]), 0], [0, 0, 0.1], [0, 0, 0]]
                for i in range(len(self.cases))
            ]
        )

    def evaluate_all(self, candidates):
        found = []
        for at in candidates:
            costs = np.sum(self.residuals(at) ** 2, 1)
            terms = np.stack([costs, *3 * [np.zeros_like(costs)]], 1)
            found.append(CaseCosts(*[np.sqrt(costs)] * 7, GOOD, terms))
        return found

    def linearise(self, coordinates, memory=np.inf):
        residuals, columns = self.residuals(coordinates), self.columns(coordinates)
        slopes = 2 * np.einsum("crg,cr->cg", columns, residuals)
        curvatures = 2 * np.einsum("crg,crh->cgh", columns, columns)
        return Linearisation(self.evaluate(coordinates), slopes, curvatures)

    def conditions(self, coordinates):
        return np.array([3.0 - coordinates[2]])

    def condition_slopes(self, coordinates):
        return np.array([[0.0, 0.0, -1.0]])


@pytest.fixture(scope="module")
def cliff(actuator):
    """Gains and closed loops of a PI, of which nothing is simulated."""
    cases = cross_cases({"printed": actuator}, {"low": Constant(0.003), "high": Constant(0.006)}, duration=5.0)
    problem = plan_tuning(PI.for_plant(actuator), cases, Objective())
    return Cliff(**{field.name: getattr(problem, field.name) for field in dataclasses.fields(problem)})


def finish(tuner):
    while not tuner.progress.finished:
        tuner.step()
    return tuner.progress


@pytest.fixture(scope="module")
def lowest(cliff):
    """By SciPy, from where the valley is known to be."""
    found = scipy.optimize.minimize(cliff.cost, [3.0, 0.0, 1.0], method="Nelder-Mead", options={"maxiter": 2000})
    assert cliff.conditions(found.x)[0] > 0, "the lowest point is inside"
    return found.fun


def test_derivatives_alone_stay_before_a_cliff_that_they_do_not_see(cliff, lowest, monkeypatch):
    monkeypatch.setattr(Tuner, "_by_costs", lambda self: False)
    tuner = Tuner(cliff)
    for _ in range(20):
        tuner.step()
    assert tuner.progress.cost > 5 * lowest
    assert tuner.progress.linearisations >= 20


def test_costs_alone_lead_past_it(cliff, lowest):
    progress = finish(Tuner(cliff))
    assert progress.converged
    # What counts as progress is 2 % in three steps, in a valley that is flat along two gains.
    assert lowest * (1 - 1e-6) <= progress.cost < 1.1 * lowest
    assert set(progress.kinds) == {False, True}


def test_every_evaluation_is_counted(cliff):
    class Counting(Cliff):
        evaluations = linearisations = 0

        def evaluate_all(self, candidates):
            Counting.evaluations += len(candidates)
            return super().evaluate_all(candidates)

        def linearise(self, coordinates, memory=np.inf):
            Counting.linearisations += 1
            Counting.evaluations -= 1  # for its own costs it asks as others do
            return super().linearise(coordinates, memory)

    progress = finish(Tuner(Counting(**{f.name: getattr(cliff, f.name) for f in dataclasses.fields(cliff)})))
    assert progress.trials + 1 == Counting.evaluations == len(progress.costs)
    assert progress.linearisations == Counting.linearisations > 0
    assert min(progress.costs) == progress.cost == cliff.cost(np.asarray(progress.coordinates))
    assert progress.costs == tuple(cliff.cost(np.asarray(at)) for at in progress.tried)


def tuples(value):
    """JSON has lists for them."""
    return tuple(map(tuples, value)) if isinstance(value, list) else value


@pytest.mark.parametrize("place", [1, 4])
def test_a_search_that_was_interrupted_goes_on_as_if_it_had_not_been(cliff, place):
    """In a step by derivatives, and in one by costs; what is kept of it is JSON."""
    tuner = Tuner(cliff)
    for _ in range(place):
        kept = tuner.step()
    fields = json.loads(json.dumps(dataclasses.asdict(kept), allow_nan=False))
    resumed = Tuner(cliff, TuningProgress(**{name: tuples(value) for name, value in fields.items()}))
    assert kept.kinds[-1] == (place == 4)
    assert finish(resumed) == finish(tuner)


def test_progress_without_a_model_goes_on_with_derivatives(cliff):
    """As an earlier version has kept it."""
    tuner = Tuner(cliff)
    while not tuner.step().kinds[-1]:
        pass
    hoping = dataclasses.replace(tuner.progress, hopes=(0.0, 1.0))
    assert Tuner(cliff, hoping).step().kinds[-1]
    assert not Tuner(cliff, dataclasses.replace(hoping, model=None)).step().kinds[-1]


def test_candidates_are_inside_bounds_and_conditions(cliff):
    """Around a best that is at the edge of both."""
    upper = np.array([0.1, np.inf, np.inf])
    transform = dataclasses.replace(cliff.transform, upper=upper)
    edge = dataclasses.replace(cliff, transform=transform)
    tried = np.array([[0.1, 0.0, 3.0], [0.0, 0.0, 2.0], [-1.0, 0.5, 1.0], [-1.0, -0.5, 0.0]])
    costs, model = np.array([1.0, 2.0, 3.0, np.inf]), model_at(edge, tried[1], edge.linearise(tried[1]))
    found = scatter(edge, tried, costs, 1.0, 0, model)
    assert found.shape == (len(BOLDNESS), 3)
    assert np.all(found <= upper)
    assert all(np.all(edge.conditions(at) >= 0) for at in found)
    assert len(np.unique(found, axis=0)) == len(found)
    np.testing.assert_array_equal(found, scatter(edge, tried, costs, 1.0, 0, model))


class Inert(Cliff):
    """Noise rises as the error falls, and a gain spares it where it is small; at the start it does nothing."""

    @property
    def start(self):
        return np.array([0.0, 0.0, 0.0])

    def residuals(self, at):
        spared = np.exp(-4 * (at[1] + 6))
        rows = [np.exp(-at[0]), 0.3 * np.exp(at[0]) / (1 + spared), 0.05 * spared, 0.1 * at[2]]
        return np.array([[(10 - i) * each for each in rows] for i in range(len(self.cases))])

    def columns(self, at):
        spared, noise = np.exp(-4 * (at[1] + 6)), 0.3 * np.exp(at[0])
        rows = np.array(
            [
                [-np.exp(-at[0]), 0, 0],
                [noise / (1 + spared), 4 * noise * spared / (1 + spared) ** 2, 0],
                [0, -4 * 0.05 * spared, 0],
                [0, 0, 0.1],
            ]
        )
        return np.array([(10 - i) * rows for i in range(len(self.cases))])


def test_a_gain_that_does_nothing_at_the_start_is_tried_where_it_does(cliff, monkeypatch):
    inert = Inert(**{field.name: getattr(cliff, field.name) for field in dataclasses.fields(cliff)})
    lowest = scipy.optimize.minimize(inert.cost, [1.5, -6.3, 0.0], method="Nelder-Mead").fun
    slopes = np.abs(inert.linearise(inert.start).slopes[0])
    assert slopes[1] < 1e-6 * slopes[0], "derivatives say nothing of it"
    # What counts as progress is 2 % in three steps.
    assert finish(Tuner(inert)).cost < 1.1 * lowest
    monkeypatch.setattr(_scatter, "_alone", lambda gains, rng: np.zeros((_scatter.ALONE, gains)))
    monkeypatch.setattr(_scatter, "_around", lambda surrogate, reach, count, rng: np.zeros((count, 3)))
    # Measured: 3.8 times.
    assert finish(Tuner(inert)).cost > 2 * lowest, "where the model leads it does nothing"


def test_one_candidate_of_a_batch_moves_one_gain_alone_and_far(cliff):
    tried = np.array([[0.0, 0.5, 0.0], [0.1, 0.5, 0.0], [0.0, 0.4, 0.1], [0.2, 0.5, -0.1]])
    costs = np.array([cliff.cost(at) for at in tried])
    model, best = model_at(cliff, tried[0], cliff.linearise(tried[0])), tried[np.argmin(costs)]
    moves = np.array([scatter(cliff, tried, costs, 0.2, seed, model)[-1] - best for seed in range(10)])
    assert np.all(np.sum(moves != 0, axis=1) == 1)
    # A tenth of the reach around the best, and twice of it along the model, is as far as others go.
    assert np.all(np.max(np.abs(moves), axis=1) > 0.4)


def test_a_gain_that_does_nothing_anywhere_does_not_drift_without_end(cliff):
    class Idle(Inert):
        def residuals(self, at):
            return super().residuals(np.array([at[0], 0.0, at[2]]))

        def columns(self, at):
            return super().columns(np.array([at[0], 0.0, at[2]])) * np.array([1.0, 0.0, 1.0])

    idle = Idle(**{field.name: getattr(cliff, field.name) for field in dataclasses.fields(cliff)})
    tried = np.array(finish(Tuner(idle)).tried)
    assert np.max(np.abs(tried)) <= _scatter.FARTHEST
    assert np.max(np.abs(tried[:, 1])) > 1, "it was looked for"


def test_what_a_quadratic_model_expects(cliff):
    here = np.array([1.0, 0.2, 0.5])
    model = model_at(cliff, here, cliff.linearise(here))
    # Nearby its logarithm is that of the cost, but for curvature beyond Gauss and Newton's and for where it bends, a
    # hundredth; the cost is known to differ by a third at these places.
    moves = 0.1 * np.concatenate([np.eye(3), -np.eye(3)])
    truth = np.log([cliff.cost(here + move) for move in moves])
    np.testing.assert_allclose(model.expected(here + moves, 4.0), truth, atol=0.02)
    assert np.ptp(truth) > 0.1
    # A parabola below zero still has a logarithm, and one that is far away does not say how bad it is.
    falling = dataclasses.replace(model, curvature=0 * model.curvature)
    far = here - 100 * np.outer([1, -1], model.slope / np.linalg.norm(model.slope))
    low, high = falling.expected(far, 4.0)
    assert np.isfinite(low)
    assert low < np.log(model.cost) - 1
    assert high == pytest.approx(np.log(model.cost) + 4.0)
    farther = here - 1e5 * model.slope / np.linalg.norm(model.slope)
    assert falling.expected(farther[None], 4.0) == pytest.approx(np.log(model.cost) - 4.0)


def test_a_model_that_was_kept_is_the_same(cliff):
    model = model_at(cliff, cliff.start, cliff.linearise(cliff.start))
    again = QuadraticModel.of(tuples(json.loads(json.dumps(model.kept()))))
    for name in ("here", "cost", "slope", "curvature"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform(-2, 2, (40, 3))


def test_a_surrogate_knows_what_it_was_told_and_which_gain_matters(points):
    values = np.sin(2 * points[:, 0]) + 0.2 * points[:, 1]
    surrogate = fit_surrogate(points, values)
    expected, told = surrogate.predict(points)
    # What is rough has a deviation of a root of `ROUGH`, in parts of all.
    np.testing.assert_allclose(expected, values, atol=3 * np.sqrt(ROUGH) * surrogate.deviation)
    assert np.all(np.sum(told**2, 0) > 1 - 2 * ROUGH)
    far, knows_little = surrogate.predict(np.full((1, 3), 50.0))
    assert far == pytest.approx(np.mean(values))
    assert np.sum(knows_little**2) < ROUGH
    assert surrogate.lengths[0] < surrogate.lengths[1] < surrogate.lengths[2]


def test_between_its_points_a_surrogate_is_off_by_what_it_says(points):
    """By three deviations in one of twenty at most: those of a normal distribution would be one of 370."""

    def truth(at):
        return np.sin(at[:, 0]) + 0.5 * at[:, 1] ** 2

    surrogate = fit_surrogate(points, truth(points))
    others = np.random.default_rng(1).uniform(-1.5, 1.5, (200, 3))
    expected, told = surrogate.predict(others)
    deviations = surrogate.deviation * np.sqrt(1 - np.sum(told**2, 0))
    assert np.mean(np.abs(expected - truth(others)) > 3 * deviations) < 0.05
    assert np.std(expected - truth(others)) < 0.2 * np.std(truth(others))


def test_slopes_of_the_surrogates_likelihood(points):
    values = np.sin(points[:, 0])
    squares = (points[:, None] - points[None]) ** 2
    logs, step = np.array([0.1, 0.5, 1.0]), 1e-6
    _, slope = _improbability(logs, squares, values)
    differences = [
        (_improbability(logs + d, squares, values)[0] - _improbability(logs - d, squares, values)[0]) / (2 * step)
        for d in step * np.eye(3)
    ]
    # Central differences: rounding of 1e-16 of the value over the step, times a condition number of 1 / ROUGH.
    np.testing.assert_allclose(slope, differences, rtol=1e-5, atol=1e-5)
