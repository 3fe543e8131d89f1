"""What a better start buys a fit of the example: iterations, Jacobians and time, from values and from `identify`."""

import collections
import dataclasses
import time
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np

import vgtjax
from vgtjax.estimation import Computation, Progress, build_fit_problem, run_alone
from vgtjax.identification import identify, plan_fit, starting_fit
from vgtjax.parameters import build_transform
from vgtjax.plants import AbstractRodModel

from ..data import example_traces, seconds_of
from ..table import Section, seconds

SEED, STARTS, FACTOR = 19, 4, 1.5
"""Starts beside the printed one, whose entries are off by up to that factor to either side, evenly in the logarithm."""
MOVED, PATTERNS = 0.05, ("diaphragm.preload", "converter.magnetic_force*")
"""By which part of itself each of these entries is moved, to see how far the traces are from linear in it."""
JACOBIANS, SIMULATIONS = "Jacobians", "simulations"
COLUMNS = ("start", "chi^2/N there", "steps", "corrections", JACOBIANS, SIMULATIONS, "fit", "identify", "chi^2/N")
T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class _Fitted:
    """What a fit took; `history` is the cost at its start and after every step."""

    progress: Progress
    history: list[float]
    asked: collections.Counter[str]
    cpu: float


def measure() -> Section:
    """Fits the example from several starts, each as it is and after the step-by-step identification."""
    traces = example_traces()
    section = Section("Iterations", _about(traces), COLUMNS, notes=[*_NOTES, _nonlinear(traces)])
    _fit(_identified(vgtjax.Actuator(), traces)[0], traces)  # compiles
    for name, model in _starts():
        better, spent = _identified(model, traces)
        for label, start, before in ((name, model, 0.0), (f"{name}, identified", better, spent)):
            fitted = _fit(start, traces)
            progress, asked = fitted.progress, fitted.asked
            searched = progress.iteration - progress.corrections
            counts = (searched, progress.corrections, asked[JACOBIANS], asked[SIMULATIONS])
            costs = [f"{2 * cost:.4g}" for cost in (fitted.history[0], progress.cost)]
            times = seconds(fitted.cpu), seconds(before) if before else ""
            section.add(label, costs[0], *map(str, counts), *times, costs[1])
    return section


def _nonlinear(traces: list[vgtjax.Trace]) -> str:
    """How much of what a move of an entry changes in the traces is not linear, in units of the noise."""
    task = plan_fit(vgtjax.Actuator(), traces, free=PATTERNS)
    values = task.selection.values(task.model)
    problem = build_fit_problem(
        task.model,
        task.selection,
        build_transform(vgtjax.parameter_table(task.model), task.selection.entries, values, task.bounds),
        traces,
    )
    here = np.asarray(problem.transform.to_coordinates(values))
    before, slopes = problem.residuals_and_jacobian(here)
    parts = []
    for number, entry in enumerate(task.selection.entries):
        moved = values.copy()
        moved[number] *= 1 + MOVED
        # The derivatives are with respect to coordinates, and a move is in the entry itself.
        step = MOVED * values[number] / np.asarray(problem.transform.slope(here))[number]
        change = np.asarray(problem.residuals(problem.transform.to_coordinates(moved)) - before)
        parts.append(f"{entry} {np.linalg.norm(change - slopes[:, number] * step) / np.linalg.norm(change):.0%}")
    return (
        f"Moved by {MOVED:.0%} from its printed value, so much of what an entry changes in position and pressure is "
        f"not linear: {', '.join(parts)}. Of a sensor's offset, which is eliminated, nothing."
    )


_NOTES = [
    "Steps are those of the search, each with a Jacobian at least and up to six moves; corrections follow it. "
    "Jacobians include those of the places around the end that its errors leave possible, and simulations the trials.",
]


def _about(traces: list[vgtjax.Trace]) -> str:
    return (
        f"vgtjax.fit on {len(traces)} traces of {seconds_of(traces):.0f} s together, all programs compiled; times are "
        f"those of all processors. Starts are the printed values, and {STARTS} with every free entry off by up to a "
        f"factor of {FACTOR:g}."
    )


def _starts() -> Iterator[tuple[str, vgtjax.Actuator]]:
    printed = vgtjax.Actuator()
    selection, rng = vgtjax.select(printed), np.random.default_rng(SEED)
    values = selection.values(printed)
    yield "printed", printed
    for number in range(STARTS):
        yield f"off {number + 1}", selection.unpack(printed, values * FACTOR ** rng.uniform(-1, 1, len(values)))


def _identified(model: AbstractRodModel, traces: list[vgtjax.Trace]) -> tuple[AbstractRodModel, float]:
    """What the bench tests of chapters 2 and 3 make of a model, and the s of all processors that they took."""
    began = time.process_time()
    for moved, _ in identify(model, traces):
        model = moved
    return model, time.process_time() - began


def _fit(model: vgtjax.AbstractModel, traces: list[vgtjax.Trace]) -> _Fitted:
    asked, history, began = collections.Counter[str](), list[float](), time.process_time()

    def whole() -> Computation[Any]:
        calibrator = yield from starting_fit(plan_fit(model, traces))
        history.extend(calibrator.minimiser.progress.history)
        return (yield from calibrator.steps())

    found = run_alone(counted(whole(), asked))
    return _Fitted(found.progress, history, asked, time.process_time() - began)


def counted(computation: Computation[T], asked: collections.Counter[str]) -> Computation[T]:
    """The same computation, counting what it asks of the simulator; products in reverse mode are no Jacobians."""
    answers: Any = None
    while True:
        try:
            question = computation.send(answers)
        except StopIteration as end:
            return end.value
        for each in question:
            derived = each.selection is not None and each.cotangent is None and bool(each.selection.entries)
            asked[JACOBIANS if derived else SIMULATIONS] += 1
        answers = yield question
