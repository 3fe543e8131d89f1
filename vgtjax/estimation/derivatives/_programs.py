"""Who drives fits: one alone on all devices, or many side by side in programs that they share."""

import contextlib
import dataclasses
import os
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from ..._errors import SimulationError
from ..._kept import preparing
from ..._lanes import fill_devices, map_rows, share_out
from ...parts import has_tables
from ...simulation import RESULTS
from ._evaluation import Arguments, Computation, Evaluated, Evaluation
from ._sensitivities import observe, observe_backwards, observe_together, observe_with_jacobian, prepare
from ._trajectories import Segments

T = TypeVar("T")
Name = TypeVar("Name", bound=Hashable)
Question = Sequence[Evaluation]
Answer = Sequence[Evaluated]

FITS_OF_AN_ACCELERATOR = 16
"""Fits in one program on a device that is no CPU."""
WIDE = 4
"""Simulations that one computation asks for together in one program: of all cores if it runs alone, of each core if
others run beside it. They fill vector units, and each takes 0.37 of the time that it takes by itself (four traces of a
unit, 185 s). One with derivatives fills them anyway. Rounding depends on the width, so it must not depend on what
others ask at the same time."""
LONG, MANY = 10.0, 100.0
"""s of all traces together from which that is worth a program of its own, which compiles in seconds; or s of all that
is asked for together, as by many short searches side by side."""
WAVES = 4
"""Programs that all fits under way fill: with fewer, the last ones run half empty more often."""


def run_alone(computation: Computation[T], foreseen: Sequence[Question] = ()) -> T:
    """Drives one computation to its end; each evaluation is spread over all devices, or many of one question are.

    **Arguments:** `foreseen`: what it will ask, whose programs are compiled beside it.
    """
    with compiling_ahead(foreseen):
        return _run_alone(computation)


def compiling_ahead(questions: Iterable[Question]) -> contextlib.AbstractContextManager[None]:
    """While its block runs, programs of what a computation will ask that runs alone are compiled in a thread of their
    own, where the questions are made as well."""
    return preparing(questions, _prepare_alone)


def _run_alone(computation: Computation[T]) -> T:
    answers: Answer | None = None
    while isinstance(came := _go_on(computation, answers), _Asked):
        answers = _answer_alone(came.question)
    if isinstance(came, SimulationError):
        raise came
    return came


def _answer_alone(question: Question) -> Answer:
    """Many simulations side by side; those with derivatives one after the other, each on all devices: it takes as long
    as side by side, and a fit has compiled that for its start."""
    plain = [each for each in question if each.selection is None]
    together = iter(_wide_answer(plain) if _wide(plain) else [_evaluate(each) for each in plain])
    return [next(together) if each.selection is None else _evaluate(each) for each in question]


def run_together(
    computations: Mapping[Name, Computation[T]],
    finished: Callable[[Name, T | SimulationError], None],
    foreseen: Sequence[Question] = (),
) -> None:
    """Drives computations of one kind side by side, and calls `finished` with what came of each as it ends.

    What fails touches no other; where one ends the next begins. Neither changes the bits of those beside it.

    **Arguments:** `foreseen`: what each will ask, whose programs are compiled beside them.
    """
    with preparing(foreseen, _prepare_together):
        _run_together(computations, finished)


def _run_together(
    computations: Mapping[Name, Computation[T]], finished: Callable[[Name, T | SimulationError], None]
) -> None:
    waiting, running, board = deque(computations.items()), dict[Name, Computation[T]](), _Board[Name](_width_together())
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        answered: list[tuple[Name, Answer | None]] = []
        while waiting or running or answered:
            while waiting and len(running) < WAVES * _fits_of_a_program():
                name, computation = waiting.popleft()
                running[name] = computation
                answered.append((name, None))
            # Between simulations they do linear algebra, on one core each.
            onward = threads.map(_go_on, [running[name] for name, _ in answered], [answer for _, answer in answered])
            for (name, _), came in zip(answered, onward, strict=True):
                if isinstance(came, _Asked):
                    board.ask(name, came.question)
                else:
                    del running[name]
                    finished(name, came)
            board.run()
            answered = list(board.answered())


def _go_on(computation: Computation[T], answers: Answer | None) -> "_Asked | T | SimulationError":
    """What a computation asks for next, or what came of it."""
    try:
        return _Asked(computation.send(answers))
    except StopIteration as end:
        return end.value
    except SimulationError as error:
        return error
    except np.linalg.LinAlgError as error:
        failed = SimulationError(f"its linear problem can't be solved ({error}); start elsewhere, or give bounds")
        failed.__cause__ = error
        return failed


class _Asked(NamedTuple):
    """What a computation waits for."""

    question: Question


def _wide(question: Question) -> bool:
    """Whether simulations without derivatives that are asked for together are worth a program of their own."""
    plain = [each for each in question if each.selection is None]
    if len(plain) < WIDE:
        return False
    seconds = sum(float(np.sum(bundle.drive.duration)) for bundle in plain[0].bundles)
    return seconds >= LONG or len(plain) * seconds >= MANY


def _fits_of_a_program() -> int:
    return jax.device_count() * (1 if jax.default_backend() == "cpu" else FITS_OF_AN_ACCELERATOR)


def _width_together() -> int:
    return jax.device_count() * WIDE if jax.default_backend() == "cpu" else _fits_of_a_program()


def _evaluate(asked: Evaluation) -> Evaluated:
    return _answered([_simulated(each) for each in asked.arguments()])


def _simulated(asked: Arguments) -> "_Found":
    model, selection, bundle, delay, cotangent = asked
    if selection is None:
        observed, ended = observe(model, bundle, delay)
        return observed, None, ended
    if cotangent is not None:
        return None, observe_backwards(model, selection, bundle, delay, cotangent), None
    return observe_with_jacobian(model, selection, bundle, delay)


def _answered(found: Sequence["_Found"]) -> Evaluated:
    """The answer of what is observed along each bundle, its derivatives, and how it ended: of what was asked for."""
    observed = [np.asarray(seen) for seen, _, _ in found if seen is not None]
    columns = [np.asarray(each) for _, each, _ in found if each is not None]
    return Evaluated(observed, columns, [end for _, _, end in found if end is not None])


def _prepare_alone(question: Question) -> None:
    """Compiles what `run_alone` answers a question by; not for models with tables, which are computed on the way."""
    if has_tables(question[0].model):
        return
    if _wide(question):
        _prepare_lanes(question[0], fill_devices(WIDE))
        return
    for each in question:
        for arguments in each.arguments():
            prepare(*arguments)


def _prepare_together(question: Question) -> None:
    """Compiles what `run_together` answers a question by, but for models with tables."""
    if not has_tables(question[0].model):
        wide = _width_together() if _wide(question) else _fits_of_a_program()
        _prepare_lanes(question[0], _lanes_of(question[0], wide))


def _prepare_lanes(asked: Evaluation, lanes: int) -> None:
    """Compiles the program of so many evaluations side by side."""
    for arguments in asked.arguments():
        each = _Waiting.of((None, 0, 0), arguments, lanes)
        rows = jax.tree.map(lambda leaf: np.stack([leaf] * fill_devices(lanes)), each.arrays)
        observe_together.prepare(share_out(rows), each.rest, each.substeps, each.segments)


def _lanes_of(asked: Evaluation, wide: int) -> int:
    """Evaluations in one program: one with derivatives fills vector units by itself."""
    return wide if asked.selection is None else _fits_of_a_program()


def _wide_answer(question: Question) -> Answer:
    board = _Board[None](fill_devices(WIDE))
    board.ask(None, question)
    while not (answered := board.answered()):
        board.run()
    return answered[0][1]


class _Waiting(NamedTuple):
    """One simulation: whose it is and where its answer belongs, its arrays, the rest of it, its steps an interval, the
    segments that its traces fill, what others that run beside it have alike, how many these are, and its work: all
    steps, those of derivatives included."""

    belongs: tuple[Hashable, int, int]
    arrays: Any
    rest: Any
    substeps: np.ndarray
    segments: Segments
    shape: Hashable
    lanes: int
    work: int

    @staticmethod
    def of(belongs: tuple[Hashable, int, int], arguments: Arguments, lanes: int) -> "_Waiting":
        model, selection, bundle, delay, cotangent = arguments
        substeps = int(bundle.plan.substeps)
        # The steps of all are given by themselves: those of its own would make every fit wait for the others.
        alike = bundle if cotangent is None else bundle.reversible()
        alike = eqx.tree_at(lambda bundle: bundle.plan.substeps, alike, 0)
        arrays, rest = eqx.partition((model, selection, alike, delay, cotangent), eqx.is_array_like)
        arrays = jax.tree.map(np.asarray, arrays)
        shapes = tuple((leaf.shape, leaf.dtype.str) for leaf in jax.tree.leaves(arrays))
        shape = (jax.tree.structure(arrays), *jax.tree.leaves(rest), shapes, lanes, substeps)
        work = bundle.drive.duration.size * substeps * (1 if selection is None else 1 + len(selection.entries))
        return _Waiting(belongs, arrays, rest, np.asarray(substeps), bundle.segments, shape, lanes, work)


_Found = tuple[Array | np.ndarray | None, Array | np.ndarray | None, RESULTS | None]
"""What is observed of a simulation, its derivatives, and how it ended."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Board(Generic[Name]):
    """Simulations that computations wait for, by the program that they share, and what came of those that ran.

    `wide` of those that belong together share one.
    """

    wide: int
    waiting: dict[Hashable, list[_Waiting]] = dataclasses.field(default_factory=dict)
    asked: dict[Name, Question] = dataclasses.field(default_factory=dict)
    found: dict[tuple[Hashable, int, int], _Found] = dataclasses.field(default_factory=dict)

    def ask(self, name: Name, question: Question) -> None:
        """Notes what a computation wants to know."""
        self.asked[name] = question
        wide = self.wide if _wide(question) else _fits_of_a_program()
        for which, evaluation in enumerate(question):
            for place, part in enumerate(evaluation.arguments()):
                each = _Waiting.of((name, which, place), part, _lanes_of(evaluation, wide))
                self.waiting.setdefault(each.shape, []).append(each)

    def run(self) -> None:
        """Runs all full programs, or else the one of fewest steps: others fill up until those that wait for less have
        gone on to them."""
        full = {shape: len(parts) - len(parts) % parts[0].lanes for shape, parts in self.waiting.items()}
        if self.waiting and not any(full.values()):
            shortest = min(self.waiting, key=lambda shape: self.waiting[shape][0].work)
            full = {shortest: len(self.waiting[shortest])}
        for shape, count in full.items():
            parts = self.waiting.pop(shape)
            if left := parts[count:]:
                self.waiting[shape] = left
            if count:
                belongs = [each.belongs for each in parts[:count]]
                self.found.update(zip(belongs, _simulate(parts[:count]), strict=True))

    def answered(self) -> list[tuple[Name, Answer]]:
        """Takes down the answers that are complete."""
        complete = {name: self._places(name) for name in self.asked}
        complete = {name: places for name, places in complete.items() if all(each in self.found for each in places)}
        return [(name, self._answer(name, places)) for name, places in complete.items()]

    def _places(self, name: Name) -> list[tuple[Hashable, int, int]]:
        question = self.asked[name]
        return [(name, which, place) for which, each in enumerate(question) for place in range(len(each.bundles))]

    def _answer(self, name: Name, places: list[tuple[Hashable, int, int]]) -> Answer:
        found, question = {each: self.found.pop(each) for each in places}, self.asked.pop(name)
        answers = []
        for which, evaluation in enumerate(question):
            parts = [found[name, which, place] for place in range(len(evaluation.bundles))]
            answers.append(_answered(parts))
        return answers


def _simulate(group: Sequence[_Waiting]) -> list[_Found]:
    """What is found of each simulation, as it was asked for."""

    def rows(places: np.ndarray) -> Any:
        return jax.tree.map(lambda *leaves: np.stack(leaves), *[group[place].arrays for place in places])

    rest, substeps, lanes = group[0].rest, group[0].substeps, group[0].lanes
    segments = np.max([each.segments for each in group], axis=0)
    found = map_rows(lambda arrays: observe_together(arrays, rest, substeps, segments), rows, len(group), lanes)
    return [jax.tree.map(lambda leaf, i=i: leaf[i], found) for i in range(len(group))]
