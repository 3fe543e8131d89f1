"""What fits ask of the simulator.

A fit is a generator that yields an [`Evaluation`][] wherever it needs one and goes on with the answer. So it reads from
the top, and who drives it decides what runs beside it.
"""

import dataclasses
from collections import deque
from collections.abc import Generator, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from ...parameters import Selection
from ...plants import AbstractModel, tabulated_along
from ...simulation import RESULTS, first_failure
from ._bundle import Bundle

T = TypeVar("T")

NO_NUMBER: Any = RESULTS.no_number  # a member, which mypy takes for its sentence


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    """A model to be simulated along bundles of traces, with a duty that is `delay` s late if that is given.

    With a `selection` the derivatives with respect to its parameters are asked for as well, behind them that with
    respect to the delay; with a `cotangent` of what is observed of every bundle only those of their product, in reverse
    mode.
    """

    model: AbstractModel
    bundles: Sequence[Bundle]
    delay: float | None = None
    selection: Selection | None = None
    cotangent: Sequence[np.ndarray] | None = None

    def arguments(self) -> list["Arguments"]:
        """What each simulation takes, bundle by bundle."""
        delay = None if self.delay is None else np.asarray(self.delay, float)
        pulls = [None] * len(self.bundles) if self.cotangent is None else self.cotangent
        pairs = zip(self.bundles, pulls, strict=True)
        return [Arguments(self._ready(bundle), self.selection, bundle, delay, pull) for bundle, pull in pairs]

    def _ready(self, bundle: Bundle) -> AbstractModel:
        """The model; without derivatives its tables are made here, in one program for all bundles and lanes."""
        return self.model if self.selection is not None else tabulated_along(self.model, bundle.drive)


class Arguments(NamedTuple):
    """What one simulation takes, see [`Evaluation`][]."""

    model: AbstractModel
    selection: Selection | None
    bundle: Bundle
    delay: np.ndarray | None
    cotangent: np.ndarray | None


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluated:
    """The answer by bundle: what the sensors would see `(lanes, sample, channel)` in m and Pa, and its derivatives
    `(lanes, sample, channel, parameters)` in units of the table if they were asked for; or else those of its product
    with a cotangent, `(parameters,)`, and nothing observed. `ended` says how the simulation of each trace did."""

    observed: list[np.ndarray]
    columns: list[np.ndarray]
    ended: Sequence[RESULTS] = ()

    @property
    def failed(self) -> bool:
        """Whether a simulation failed, or a sensor would not see a number."""
        return bool(self.failure)

    @property
    def failure(self) -> str:
        """Why the first simulation failed, and what helps; empty where none did."""
        # One bad number makes a sum bad, and a sum is the cheapest look at many.
        seen = all(np.isfinite(np.sum(observed)) for observed in self.observed)
        return next(filter(None, map(first_failure, self.ended)), "" if seen else first_failure(NO_NUMBER))

    def results(self, bundles: Sequence[Bundle]) -> list[RESULTS]:
        """How every trace of the bundles ended, by itself."""
        found: dict[int, RESULTS] = {}
        for bundle, lanes, ended in zip(bundles, self.observed, self.ended, strict=True):
            for place, (index, seen) in enumerate(zip(bundle.indices, bundle.from_lanes(lanes), strict=True)):
                end = jax.tree.map(lambda end, place=place: end[place], ended)
                found[index] = end if first_failure(end) or np.isfinite(np.sum(seen)) else NO_NUMBER
        return [found[index] for index in range(len(found))]


Computation = Generator[Sequence[Evaluation], Sequence[Evaluated] | None, T]
"""A computation that asks for evaluations, some at a time, on its way to a result of type `T`."""


def ask(evaluation: Evaluation) -> Computation[Evaluated]:
    """The answer to a question, inside of a computation."""
    answers = yield (evaluation,)
    assert answers is not None, "a computation goes on with an answer"
    return answers[0]


def side_by_side(computations: Sequence[Computation[T]], at_once: int | None = None) -> Computation[list[T]]:
    """One computation of many: what they ask at the same time is asked at once, of all or of `at_once` under way."""
    results, asked = dict[int, T](), dict[int, Sequence[Evaluation]]()
    waiting = deque(range(len(computations)))

    def go_on(number: int, answers: Sequence[Evaluated] | None) -> None:
        try:
            asked[number] = computations[number].send(answers)
        except StopIteration as end:
            results[number] = end.value

    while waiting or asked:
        while waiting and (at_once is None or len(asked) < at_once):
            go_on(waiting.popleft(), None)
        if not asked:
            continue
        questions, asked = asked, {}
        answers = yield [each for question in questions.values() for each in question]
        assert answers is not None, "a computation goes on with an answer"
        left = iter(answers)
        for number, question in questions.items():
            go_on(number, [next(left) for _ in question])
    return [results[number] for number in range(len(computations))]
