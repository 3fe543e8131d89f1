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
"""Fits in one program on a device that is no CPU; a core has enough to do with one."""
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


Steps = Generator[Evaluation, Evaluated | None, T]
"""A computation that asks for evaluations on its way to a result of type `T`."""


def ask(evaluation: Evaluation) -> Steps[Evaluated]:
    """The answer to a question, inside of a computation."""
    answer = yield evaluation
    assert answer is not None, "a computation goes on with an answer"
    return answer


def run_alone(computation: Steps[T]) -> T:
    """Drives one computation to its end; every evaluation is spread over all devices."""
    answer = None
    while True:
        try:
            answer = _evaluate(computation.send(answer))
        except StopIteration as end:
            return end.value


def run_together(computations: Mapping[Name, Steps[T]], finished: Callable[[Name, T | SimulationError], None]) -> None:
    """Drives computations of one kind side by side, and calls `finished` with what came of each as it ends.

    What fails touches no other; where one ends the next begins. Neither changes the bits of those beside it.
    """
    waiting, running, asked = deque(computations.items()), dict[Name, Steps[T]](), dict[Name, Evaluation]()

    def go_on(name: Name, answer: Evaluated | None) -> None:
        result: T | SimulationError
        try:
            asked[name] = running[name].send(answer)
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
        for name, answer in answers.items():
            go_on(name, answer)


def _fits_of_a_program() -> int:
    return jax.device_count() * (1 if jax.default_backend() == "cpu" else FITS_OF_AN_ACCELERATOR)


def _evaluate(asked: Evaluation) -> Evaluated:
    if asked.selection is None:
        return Evaluated([np.asarray(observe(model, bundle, delay)) for model, _, bundle, delay in asked.parts()], [])
    found = [observe_with_jacobian(*part) for part in asked.parts()]
    return Evaluated([np.asarray(observed) for observed, _ in found], [np.asarray(columns) for _, columns in found])


def _evaluate_together(asked: Sequence[Evaluation]) -> list[Evaluated]:
    """Answers many questions; simulations of equal shape share a program."""
    groups: dict[Hashable, list[_Part]] = {}
    for number, evaluation in enumerate(asked):
        for place, part in enumerate(evaluation.parts()):
            each = _Part.of(number, place, part)
            groups.setdefault(each.shape, []).append(each)
    found = {}
    for group in groups.values():
        for each, answer in zip(group, _simulate_group(group), strict=True):
            found[each.number, each.place] = answer
    answers = [[found[number, place] for place in range(len(each.bundles))] for number, each in enumerate(asked)]
    return [
        Evaluated([observed for observed, _ in each], [columns for _, columns in each if columns is not None])
        for each in answers
    ]


class _Part(NamedTuple):
    """One simulation: where its answer belongs, its arrays, the rest of it, and what others of its shape have alike."""

    number: int
    place: int
    arrays: Any
    rest: Any
    shape: Hashable

    @staticmethod
    def of(number: int, place: int, part: tuple[Any, ...]) -> "_Part":
        arrays, rest = eqx.partition(part, eqx.is_array_like)
        arrays = jax.tree.map(np.asarray, arrays)
        shapes = tuple((leaf.shape, leaf.dtype.str) for leaf in jax.tree.leaves(arrays))
        return _Part(number, place, arrays, rest, (jax.tree.structure(arrays), *jax.tree.leaves(rest), shapes))


def _simulate_group(group: Sequence[_Part]) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """What is observed of each simulation, and the derivatives where they were asked for."""

    def rows(places: np.ndarray) -> Any:
        return jax.tree.map(lambda *leaves: np.stack(leaves), *[group[place].arrays for place in places])

    found = map_rows(lambda arrays: observe_together(arrays, group[0].rest), rows, len(group), _fits_of_a_program())
    observed, columns = found
    return [(observed[i], None if columns is None else columns[i]) for i in range(len(group))]
