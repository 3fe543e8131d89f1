"""Fits whose residuals are a function that we know, and what drives a computation that asks of them."""

from collections.abc import Callable

import equinox as eqx
import numpy as np

import vgtjax
from vgtjax.estimation import Evaluated, Evaluation, FitProblem


class Known(FitProblem):
    """A problem whose residuals are a function of the coordinates."""

    function: Callable = eqx.field(static=True)

    def __init__(self, function, transform, count=60):
        actuator = vgtjax.Actuator()
        super().__init__(actuator, vgtjax.select(actuator), transform, [], [], count, 0)
        self.function = function

    def evaluation(self, coordinates):
        return Question(coordinates)

    def residuals_of(self, observed):
        return self.function(observed)


class Question(Evaluation):
    def __init__(self, coordinates):
        object.__setattr__(self, "coordinates", coordinates)


class Answer(Evaluated):
    def __init__(self, coordinates, failed):
        super().__init__(coordinates, [])
        object.__setattr__(self, "bad", failed)

    @property
    def failed(self):
        return self.bad


def driven(computation, problem=None):
    """What a computation comes to, whose questions are answered with their coordinates."""

    def fails(at):
        return problem is not None and not np.all(np.isfinite(problem.function([at])))

    answers = None
    while True:
        try:
            asked = [each.coordinates for each in computation.send(answers)]
        except StopIteration as end:
            return end.value
        answers = [Answer([at], fails(at)) for at in asked]
