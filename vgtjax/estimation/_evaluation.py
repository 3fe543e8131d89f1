"""What fits ask of the simulator: one question spread over all devices, or those of many fits side by side.

A fit is a generator that yields an [`Evaluation`][] wherever it needs one and goes on with the answer. So it reads from
the top, and who drives it decides what runs beside it.
"""

import dataclasses
from collections import deque
from collections.abc import Callable, Generator, Hashable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np

from .._errors import SimulationError
from .._lanes import map_rows
from ..parameters import Selection
from ..plants import AbstractModel
from ._bundle import Bundle
from ._sensitivities import observe, observe_together, observe_with_jacobian

T = TypeVar("T")
Name = TypeVar("Name", bound=Hashable)

FITS_OF_AN_ACCELERATOR = 16
"""Fits in one program on a device that is no CPU."""
WIDE = 4
"""Simulations that one computation asks for together in one program of a core: they fill its vector units, and each
takes 0.37 of the time that it takes alone (four traces of a unit, 185 s). One with derivatives fills them by itself.
Rounding depends on the width, so what others ask at the same time must not change it."""
LONG = 10.0
"""s of all traces together from which that is worth a program of its own, which compiles in seconds."""
WAVES = 4
"""Programs that all fits under way fill: with fewer, the last one of a round runs half empty more often."""


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    """A model to be simulated along bundles of traces, with a duty that is `delay` s late if that is given.

    With a `selection` the derivatives by its parameters are asked for as well, behind them that by the delay.
    """

    model: AbstractModel
    bundles: Sequence[Bundle]
    delay: float | None = None
    selection: Selection | None = None

    def parts(self) -> list[tuple[Any, ...]]:
        """What one simulation takes, bundle by bundle."""
        delay = None if self.delay is None else np.asarray(self.delay, float)
        return [(self.model, self.selection, bundle, delay) for bundle in self.bundles]


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluated:
    """The answer by bundle: what the sensors would see `(lanes, sample, channel)` in m and Pa, and its derivatives
    `(lanes, sample, channel, parameters)` in units of the table if they were asked for."""

    observed: list[np.ndarray]
    columns: list[np.ndarray]

    @property
    def failed(self) -> bool:
        """Whether a simulation left the finite numbers."""
        # One bad number makes a sum bad, and a sum is the cheapest look at many.
        return not all(np.isfinite(np.sum(observed)) for observed in self.observed)


Steps = Generator[Sequence[Evaluation], Sequence[Evaluated] | None, T]
"""A computation that asks for evaluations, some at a time, on its way to a result of type `T`."""


def ask(evaluation: Evaluation) -> Steps[Evaluated]:
    """The answer to a question, inside of a computation."""
    answers = yield (evaluation,)
    assert answers is not None, "a computation goes on with an answer"
    return answers[0]


def side_by_side(computations: Sequence[Steps[T]]) -> Steps[list[T]]:
    """One computation of many: what they ask at the same time is asked at once."""
    results, asked = dict[int, T](), dict[int, Sequence[Evaluation]]()

    def go_on(number: int, answers: Sequence[Evaluated] | None) -> None:
        try:
            asked[number] = computations[number].send(answers)
        except StopIteration as end:
            results[number] = end.value

    for number in range(len(computations)):
        go_on(number, None)
    while asked:
        questions, asked = asked, {}
        answers = yield [each for question in questions.values() for each in question]
        assert answers is not None, "a computation goes on with an answer"
        left = iter(answers)
        for number, question in questions.items():
            go_on(number, [next(left) for _ in question])
    return [results[number] for number in range(len(computations))]


def run_alone(computation: Steps[T]) -> T:
    """Drives one computation to its end; each evaluation is spread over all devices, or many of one question are."""
    answers: Sequence[Evaluated] | None = None
    while True:
        try:
            asked = computation.send(answers)
        except StopIteration as end:
            return end.value
        answers = _evaluate_together([asked])[0] if _wide(asked) else [_evaluate(each) for each in asked]


def run_together(computations: Mapping[Name, Steps[T]], finished: Callable[[Name, T | SimulationError], None]) -> None:
    """Drives computations of one kind side by side, and calls `finished` with what came of each as it ends.

    What fails touches no other; where one ends the next begins. Neither changes the bits of those beside it.
    """
    waiting, running = deque(computations.items()), dict[Name, Steps[T]]()
    asked = dict[Name, Sequence[Evaluation]]()

    def go_on(name: Name, answers: Sequence[Evaluated] | None) -> None:
        result: T | SimulationError
        try:
            asked[name] = running[name].send(answers)
            return
        except StopIteration as end:
            result = end.value
        except SimulationError as error:
            result = error
        del running[name]
        finished(name, result)

    while waiting or running:
        while waiting and len(running) < WAVES * _fits_of_a_program():
            name, computation = waiting.popleft()
            running[name] = computation
            go_on(name, None)
        answers = dict(zip(asked, _evaluate_together(list(asked.values())), strict=True))
        asked.clear()
        for name, part in answers.items():
            go_on(name, part)


def _wide(question: Sequence[Evaluation]) -> bool:
    """Whether what one computation asks for together is worth a program of its own."""
    if len(question) < WIDE or any(each.selection is not None for each in question):
        return False
    return sum(float(np.sum(bundle.drive.duration)) for bundle in question[0].bundles) >= LONG


def _fits_of_a_program(*, wide: bool = False) -> int:
    if jax.default_backend() != "cpu":
        return jax.device_count() * FITS_OF_AN_ACCELERATOR
    return jax.device_count() * (WIDE if wide else 1)


def _evaluate(asked: Evaluation) -> Evaluated:
    if asked.selection is None:
        return Evaluated([np.asarray(observe(model, bundle, delay)) for model, _, bundle, delay in asked.parts()], [])
    found = [observe_with_jacobian(*part) for part in asked.parts()]
    return Evaluated([np.asarray(observed) for observed, _ in found], [np.asarray(columns) for _, columns in found])


def _evaluate_together(questions: Sequence[Sequence[Evaluation]]) -> list[list[Evaluated]]:
    """Answers many questions; simulations of equal shape share a program."""
    groups: dict[Hashable, list[_Part]] = {}
    for number, question in enumerate(questions):
        wide = _wide(question)
        for which, evaluation in enumerate(question):
            for place, part in enumerate(evaluation.parts()):
                each = _Part.of((number, which, place), part, wide)
                groups.setdefault(each.shape, []).append(each)
    found: dict[tuple[int, ...], tuple[np.ndarray, np.ndarray | None]] = {}
    for group in groups.values():
        found |= dict(zip([each.belongs for each in group], _simulate_group(group), strict=True))

    def answer(number: int, which: int, evaluation: Evaluation) -> Evaluated:
        parts = [found[number, which, place] for place in range(len(evaluation.bundles))]
        return Evaluated([one for one, _ in parts], [columns for _, columns in parts if columns is not None])

    return [
        [answer(number, which, each) for which, each in enumerate(question)]
        for number, question in enumerate(questions)
    ]


class _Part(NamedTuple):
    """One simulation: where its answer belongs, its arrays, the rest of it, what others that share a program with it
    have alike, and whether that has the width of many."""

    belongs: tuple[int, ...]
    arrays: Any
    rest: Any
    shape: Hashable
    wide: bool

    @staticmethod
    def of(belongs: tuple[int, ...], part: tuple[Any, ...], wide: bool) -> "_Part":
        arrays, rest = eqx.partition(part, eqx.is_array_like)
        arrays = jax.tree.map(np.asarray, arrays)
        shapes = tuple((leaf.shape, leaf.dtype.str) for leaf in jax.tree.leaves(arrays))
        shape = (jax.tree.structure(arrays), *jax.tree.leaves(rest), shapes, wide)
        return _Part(belongs, arrays, rest, shape, wide)


def _simulate_group(group: Sequence[_Part]) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """What is observed of each simulation, and the derivatives where they were asked for."""

    def rows(places: np.ndarray) -> Any:
        return jax.tree.map(lambda *leaves: np.stack(leaves), *[group[place].arrays for place in places])

    rest, count = group[0].rest, len(group)
    lanes = _fits_of_a_program(wide=group[0].wide)
    observed, columns = map_rows(lambda arrays: observe_together(arrays, rest), rows, count, lanes)
    return [(observed[i], None if columns is None else columns[i]) for i in range(len(group))]
