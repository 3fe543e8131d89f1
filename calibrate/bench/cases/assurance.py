"""Whether what is said before a fit holds: the errors to expect, and the run to record next; and what that costs."""

import time
from collections import Counter
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

import vgtjax
from vgtjax.assurance import certifying, examining, ranking
from vgtjax.estimation import VAGUE, Computation, run_alone, run_together
from vgtjax.identification import plan_fit, starting_fit

from ...fit.beforehand import knowing
from ..campaigns import FAULTS, draw_unit, record, record_run
from ..data import example_traces
from ..table import Section, seconds

UNITS = 8
SEED = 7100
KINDS = ("step_80", "levels")
"""Traces of a campaign that a user has, so that another run is still worth something."""
THIRD = 4 / 3
"""By which factor claims may miss what was said before."""
ROUNDS = 3

T = TypeVar("T")
Ratios = list[tuple[str, float]]
"""By entry."""


def measure() -> Section:
    """Says what errors to expect and which run to record next, fits, records that run, and fits again."""
    section = Section(
        "Does a fit claim what was expected of it, and does the next run bring what was said?",
        f"{UNITS} actuators, simulated by the hard-switching plant of these benchmarks (RK4, 10 us), a step and random "
        "levels, 14 s at 1 kHz each; all that a study frees by default is fitted.",
        ("question", "within a third", "least", "median", "most"),
    )
    rng = np.random.default_rng(SEED)
    units = [draw_unit(rng) for _ in range(UNITS)]
    errors, gains = Ratios(), Ratios()

    def finished(_: int, found: tuple[Ratios, Ratios] | vgtjax.SimulationError) -> None:
        if not isinstance(found, vgtjax.SimulationError):
            errors.extend(found[0])
            gains.extend(found[1])

    run_together({number: _asking(unit, SEED + number) for number, unit in enumerate(units)}, finished)
    section.add("errors claimed, by those expected", *_summary(errors))
    section.add("factor by which the next run lowers an error, by the one that was said", *_summary(gains))
    section.notes.append(
        f"Over {len(errors)} entries of {UNITS} fits that were said to be known and are, and over {len(gains)} that "
        f"were named for the run that ranked first. Beyond a third: {_beyond(errors)}; and {_beyond(gains)}."
    )
    alone, more = _cost()
    section.notes.append(
        f"The example's fit takes {seconds(alone)} by itself; check and certificate {seconds(more)} more (medians of "
        f"{ROUNDS} rounds, programs in the cache)."
    )
    return section


def _asking(unit: vgtjax.Actuator, seed: int) -> Computation[tuple[Ratios, Ratios]]:
    """Errors claimed by errors expected, and factors by which the run that ranks first lowers them by those said."""
    rng = np.random.default_rng(seed)
    traces = [trace for trace in record(unit, rng, FAULTS[0]) if trace.name in KINDS]
    task = plan_fit(vgtjax.Actuator(), traces)
    known = yield from examining(task)
    best = (yield from ranking(task, known))[0]
    before = yield from _claims(traces)
    after = yield from _claims([*traces, record_run(unit, rng, best.run)])
    expected = {name: error for name, error in known.errors.items() if error < VAGUE and np.isfinite(before[name])}
    named = [name for name in best.lowers if np.isfinite(before[name]) and np.isfinite(after[name])]
    said = {name: old / new for name, (old, new) in best.lowers.items()}
    return (
        [(name, before[name] / error) for name, error in expected.items()],
        [(name, before[name] / after[name] / said[name]) for name in named],
    )


def _claims(traces: Sequence[vgtjax.Trace]) -> Computation[dict[str, float]]:
    """Standard errors that a fit claims, in its coordinates, as they are expected; infinite where not determined."""
    calibrator = yield from starting_fit(plan_fit(vgtjax.Actuator(), traces))
    found = yield from calibrator.steps()
    entries = found.task.selection.entries
    errors = np.where(found.determined, found.uncertainty.std_errors[: len(entries)], np.inf)
    return dict(zip(entries, errors.tolist(), strict=True))


def _summary(ratios: Ratios) -> tuple[str, ...]:
    values = [ratio for _, ratio in ratios]
    least, median, most = np.quantile(values, [0, 0.5, 1])
    return (f"{100 * np.mean(_inside(values)):.0f} %", f"{least:.2f}", f"{median:.2f}", f"{most:.2f}")


def _inside(ratios: Sequence[float]) -> np.ndarray:
    return np.abs(np.log(ratios)) <= np.log(THIRD)


def _beyond(ratios: Ratios) -> str:
    """Entries that miss a third, and how often."""
    missed = Counter(name for name, ratio in ratios if not _inside([ratio])[0])
    return ", ".join(f"{name} ({count})" for name, count in missed.most_common())


def _cost() -> tuple[float, float]:
    """s that the example's fit takes, and that check and certificate take besides."""
    task, alone, more = plan_fit(vgtjax.Actuator(), example_traces()), list[float](), list[float]()
    for _ in range(ROUNDS + 1):
        start, planned = _timed(starting_fit(task))
        _, asked = _timed(knowing(start))
        end, searched = _timed(start.ending())
        _, closed = _timed(end.finishing())
        _, certified = _timed(certifying(end))
        alone.append(planned + searched + closed)
        more.append(asked + certified)
    return float(np.median(alone[1:])), float(np.median(more[1:]))


def _timed(steps: Computation[T]) -> tuple[T, float]:
    began = time.perf_counter()
    return run_alone(steps), time.perf_counter() - began
