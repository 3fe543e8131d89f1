"""Derivatives of all traces: at one place, or over the places that an end may as well be at.

A plunger that lands between two steps, or a rod that sticks a sample later, changes the derivatives at a place from
those a microsecond beside it, and an error that is read off one place is that of its kinks: beside a late duty, which
moves all events through the steps, that of the delay came out between 5 and 37 us in campaigns that tell it to 30 us.
What a linear model should have is the mean over the errors that it claims (statistical linearisation, Gelb 1974;
by Stein's lemma it is the best linear fit).
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ..parameters import Selection, select
from ._bundle import Bundle
from ._evaluation import Evaluated, Evaluation, Steps, ask
from ._least_squares import LeastSquares
from ._residuals import FitProblem

PAIRS = 2
"""Pairs of opposite places beside the end itself; with four the errors of 25 campaigns were the same."""
FARTHEST = 0.3
"""Coordinates by which a standard error of any direction moves one at most, however little is known of that."""
SEED = 1966

Coordinates = Float[np.ndarray, " coordinates"]
Columns = list[np.ndarray]
"""By bundle, what is observed by each parameter."""


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of all traces: what is `evaluated` at some coordinates, and `columns`, which are their means over
    places `around` it where there are any."""

    at: Coordinates
    evaluated: Evaluated
    columns: Columns
    around: Sequence[Coordinates] = ()
    _with_delay: "Slopes | None" = dataclasses.field(default=None, init=False)

    @staticmethod
    def find(problem: FitProblem, at: Coordinates, around: Sequence[Coordinates] = ()) -> Steps["Slopes"]:
        """Derivatives at some coordinates, and around them."""
        evaluated = yield from _derivatives(problem, problem.bundles, at)
        here = Slopes(at, evaluated, evaluated.columns, around)
        return dataclasses.replace(here, columns=(yield from here.mean(problem, problem.bundles, evaluated.columns)))

    @property
    def alone(self) -> "Slopes":
        """Derivatives of the place itself."""
        return Slopes(self.at, self.evaluated, self.evaluated.columns)

    def along(self, problem: FitProblem, bundles: Sequence[Bundle]) -> Steps[Evaluated]:
        """The same derivatives of other traces."""
        evaluated = yield from _derivatives(problem, bundles, self.at)
        columns = yield from self.mean(problem, bundles, evaluated.columns)
        return dataclasses.replace(evaluated, columns=columns)

    def with_delay(self, problem: FitProblem) -> Steps["Slopes"]:
        """The same derivatives, and that with respect to the delay of a duty which was taken for timely.

        Several questions ask for it, and it is computed once. **Arguments:** `problem`: with the delay free.
        """

        def asked(place: Coordinates) -> Steps[Evaluated]:
            return problem.beside_edges((yield from ask(by_delay_alone(problem, place))), place)

        if self._with_delay is None:
            own = (yield from asked(self.at)).columns
            late = yield from _mean_columns(own, self.around, asked, lambda _: np.ones(1))
            pairs = zip(self.columns, late, strict=True)
            columns = [np.concatenate([each[..., :-1], more], axis=-1) for each, more in pairs]
            object.__setattr__(self, "_with_delay", dataclasses.replace(self, columns=columns))
        assert self._with_delay is not None, "it has just been made"
        return self._with_delay

    def held(self, problem: FitProblem, entries: Sequence[str]) -> Steps[Columns]:
        """Derivatives of the same places with respect to entries that are held, in units of the table."""

        def asked(place: Coordinates) -> Steps[Evaluated]:
            question = problem.evaluation(place)
            return (yield from ask(dataclasses.replace(question, selection=select(question.model, list(entries)))))

        own = yield from asked(self.at)
        return (yield from _mean_columns(own.columns, self.around, asked, lambda _: np.ones(1)))

    def mean(self, problem: FitProblem, bundles: Sequence[Bundle], own: Columns) -> Steps[Columns]:
        """The mean over all places of what is `own` to the first."""
        slope = problem.transform.slope

        def units(place: Coordinates) -> np.ndarray:
            return np.asarray(slope(place)) / np.asarray(slope(self.at))

        return (yield from _mean_columns(own, self.around, lambda at: _derivatives(problem, bundles, at), units))


def _derivatives(problem: FitProblem, bundles: Sequence[Bundle], at: Coordinates) -> Steps[Evaluated]:
    """What is observed of traces at some coordinates, and its derivatives."""
    question = dataclasses.replace(problem.evaluation(at, slopes=True), bundles=bundles)
    answer = yield from ask(question)
    evaluated = dataclasses.replace(answer, columns=[problem.with_held_delay(each) for each in answer.columns])
    return problem.beside_edges(evaluated, at) if bundles is problem.bundles else evaluated


def by_delay_alone(problem: FitProblem, at: Coordinates) -> Evaluation:
    """The question how what is observed changes with the delay of the duty, which is free in the problem."""
    return dataclasses.replace(problem.evaluation(at), selection=Selection(()))


def places_around(found: LeastSquares, at: Coordinates) -> list[Coordinates]:
    """Places that the errors of an end leave possible, in pairs to either side; what is not determined stays."""
    errors = np.where(found.determined, np.nan_to_num(found.std_errors), 0.0)
    sizes = np.where(errors > 0, errors, 1.0)
    known = np.outer(errors > 0, errors > 0)
    parts, ways = np.linalg.eigh(np.where(known, found.covariance / np.outer(sizes, sizes), 0.0))
    factor = errors[:, None] * ways * np.sqrt(np.maximum(parts, 0.0))
    # Whole directions are shortened: parts of one would lead to where the traces rule it out.
    factor = factor / np.maximum(1.0, np.max(np.abs(factor), axis=0) / FARTHEST)
    moves = np.random.default_rng(SEED).standard_normal((PAIRS, len(at))) @ factor.T
    return [at + sign * move for move in moves for sign in (1.0, -1.0)]


def _mean_columns(
    own: Columns,
    places: Sequence[Coordinates],
    asked: Callable[[Coordinates], Steps[Evaluated]],
    units: Callable[[Coordinates], np.ndarray],
) -> Steps[Columns]:
    """The mean of columns at an end and at places around it, without those where a simulation fails.

    **Arguments:** `asked`: what is observed at a place, and its derivatives; `units` that these have there, in those of
    `own`.
    """
    if not places:
        return own
    total, count = own, 1
    for place in places:
        try:
            there = yield from asked(place)
        except SimulationError:
            continue
        if there.failed or not _as_finite(there.columns, own):
            continue
        factor = units(place)
        total = [sum_ + each * factor for sum_, each in zip(total, there.columns, strict=True)]
        count += 1
    return [each / count for each in total]


def _as_finite(columns: Columns, own: Columns) -> bool:
    """Whether all columns are finite that are so at the end."""
    found, wanted = (np.isfinite(sum(np.sum(each, axis=(0, 1, 2)) for each in lists)) for lists in (columns, own))
    return bool(np.all(found | ~wanted))
