"""Derivatives of all traces: at one place, or over the places that an end may as well be at.

A plunger that lands between two steps, or a rod that sticks a sample later, changes the derivatives at a place from
those a microsecond beside it, and an error that is read off one place is that of its kinks: beside a late duty, which
moves all events through the steps, that of the delay came out between 5 and 37 us in campaigns that tell it to 30 us.
What a linear model should have is the mean over the errors that it claims (statistical linearisation, Gelb 1974;
by Stein's lemma it is the best linear fit).
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..._types import Coordinates
from ...parameters import Selection, select
from .._least_squares import LeastSquares, root_of
from ..derivatives import Believed, Bundle, Columns, Computation, Evaluated, Evaluation, ask, mean_columns
from ..measurements import FitProblem

PAIRS = 2
"""Pairs of opposite places beside the end itself; with four the errors of 25 campaigns were the same."""
NUDGE = 1e-3
"""Coordinates by which all are moved where derivatives tell of none: they explode at that place."""
FARTHEST = 0.3
"""Coordinates by which a standard error of any direction moves one at most, however little is known of that."""
SEED = 1966


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of all traces: what is `evaluated` at some coordinates, and `columns`, which are their means over
    places `around` it where there are any, by the rows of each that are `believed`."""

    at: Coordinates
    evaluated: Evaluated
    columns: Columns
    around: Sequence[Coordinates] = ()
    believed: Believed | None = None
    _with_delay: "Slopes | None" = dataclasses.field(default=None, init=False)

    @staticmethod
    def find(problem: FitProblem, at: Coordinates, around: Sequence[Coordinates] = ()) -> Computation["Slopes"]:
        """Derivatives at some coordinates, and around them."""
        evaluated = yield from _derivatives(problem, problem.bundles, at)
        here = Slopes(at, evaluated, evaluated.columns, around)
        columns, believed = yield from here.mean(problem, problem.bundles, evaluated.columns)
        return dataclasses.replace(here, columns=columns, believed=believed)

    @property
    def alone(self) -> "Slopes":
        """Derivatives of the place itself."""
        return Slopes(self.at, self.evaluated, self.evaluated.columns)

    def along(self, problem: FitProblem, bundles: Sequence[Bundle]) -> Computation[Evaluated]:
        """The same derivatives of other traces."""
        evaluated = yield from _derivatives(problem, bundles, self.at)
        columns, _ = yield from self.mean(problem, bundles, evaluated.columns)
        return dataclasses.replace(evaluated, columns=columns)

    def with_delay(self, problem: FitProblem) -> Computation["Slopes"]:
        """The same derivatives, and that with respect to the delay of a duty which was taken for timely.

        Several questions ask for it, and it is computed once. **Arguments:** `problem`: with the delay free.
        """

        def asked(place: Coordinates) -> Computation[Evaluated]:
            return problem.beside_edges((yield from ask(by_delay_alone(problem, place))), place)

        if self._with_delay is None:
            own = (yield from asked(self.at)).columns
            late = yield from self._of_the_same_rows(own, asked)
            pairs = zip(self.columns, late, strict=True)
            columns = [np.concatenate([each[..., :-1], more], axis=-1) for each, more in pairs]
            object.__setattr__(self, "_with_delay", dataclasses.replace(self, columns=columns))
        assert self._with_delay is not None, "it has just been made"
        return self._with_delay

    def held(self, problem: FitProblem, entries: Sequence[str]) -> Computation[Columns]:
        """Derivatives of the same places with respect to entries that are held, in units of the table."""

        def asked(place: Coordinates) -> Computation[Evaluated]:
            question = problem.evaluation(place)
            return (yield from ask(dataclasses.replace(question, selection=select(question.model, list(entries)))))

        own = yield from asked(self.at)
        return (yield from self._of_the_same_rows(own.columns, asked))

    def mean(
        self, problem: FitProblem, bundles: Sequence[Bundle], own: Columns
    ) -> Computation[tuple[Columns, Believed]]:
        """The mean over all places of what is `own` to the first, and which rows of each are in it."""
        slope = problem.transform.slope
        others = [functools.partial(_derivatives, problem, bundles, place) for place in self.around]
        units = [np.asarray(slope(place)) / np.asarray(slope(self.at)) for place in self.around]
        return (yield from mean_columns(own, others, units))

    def _of_the_same_rows(
        self, own: Columns, asked: Callable[[Coordinates], Computation[Evaluated]]
    ) -> Computation[Columns]:
        """The mean of other columns over the same rows of the same places."""
        others = [functools.partial(asked, place) for place in self.around]
        columns, _ = yield from mean_columns(own, others, [np.ones(1)] * len(others), self.believed)
        return columns


def _derivatives(problem: FitProblem, bundles: Sequence[Bundle], at: Coordinates) -> Computation[Evaluated]:
    """What is observed of traces at some coordinates, and its derivatives."""
    question = dataclasses.replace(problem.evaluation(at, slopes=True), bundles=bundles)
    answer = yield from ask(question)
    evaluated = dataclasses.replace(answer, columns=[problem.with_held_delay(each) for each in answer.columns])
    return problem.beside_edges(evaluated, at) if bundles is problem.bundles else evaluated


def by_delay_alone(problem: FitProblem, at: Coordinates) -> Evaluation:
    """The question how what is observed changes with the delay of the duty, which is free in the problem."""
    return dataclasses.replace(problem.evaluation(at), selection=Selection(()))


def places_around(found: LeastSquares, at: Coordinates) -> list[Coordinates]:
    """Places that the errors of an end leave possible, in pairs to either side; what is not estimable stays."""
    if not np.any(found.estimable):
        return _pairs(at, NUDGE * np.eye(len(at)))
    factor = root_of(np.where(np.outer(found.estimable, found.estimable), found.covariance, 0.0))
    # Whole directions are shortened: parts of one would lead to where the traces rule it out.
    return _pairs(at, factor / np.maximum(1.0, np.max(np.abs(factor), axis=0) / FARTHEST))


def _pairs(at: Coordinates, factor: Float[np.ndarray, "coordinates directions"]) -> list[Coordinates]:
    moves = np.random.default_rng(SEED).standard_normal((PAIRS, len(at))) @ factor.T
    return [at + sign * move for move in moves for sign in (1.0, -1.0)]
