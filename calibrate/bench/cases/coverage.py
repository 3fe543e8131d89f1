"""How often the intervals of a fit hold the truth, over campaigns of random actuators whose parameters are known."""

import time

import numpy as np
import scipy.stats

import vgtjax
from vgtjax import SimulationError
from vgtjax.estimation import Steps, run_together
from vgtjax.identification import plan_fit, starting_fit

from ..campaigns import FAULTS, Fault, draw_unit, record
from ..table import Section

CAMPAIGNS = 25
"""Of each fault."""
SEED = 2012


def measure() -> Section:
    """Fits every campaign as the command line would, without a word on what is wrong with it."""
    section = Section(
        "Do 95 % intervals hold the truth?",
        f"{CAMPAIGNS} actuators for each fault, 31 s at 1 kHz each, simulated by the hard-switching plant of these "
        "benchmarks (RK4, 10 us); all that a study frees by default is fitted, and nothing is said of the fault.",
        (
            "what is wrong",
            "hold the truth",
            "least of an entry",
            "has an interval",
            "largest mean error",
            "failed",
            "each",
        ),
    )
    for number, fault in enumerate(FAULTS):
        section.add(*_measure(fault, SEED + number))
    section.notes.append(
        "Least of an entry: the lowest share of one entry; of 25 intervals, honest ones rarely miss more than four. "
        "Largest mean error: the mean over campaigns, in standard errors, of the entry where it is largest. Each: wall "
        "time of a campaign and its fit, as many side by side as there are cores."
    )
    return section


def _measure(fault: Fault, seed: int) -> tuple[str, ...]:
    """A row of the table."""
    rng, scores, began = np.random.default_rng(seed), [], time.perf_counter()
    units = [draw_unit(rng) for _ in range(CAMPAIGNS)]
    fits = {number: fitting(record(unit, rng, fault)) for number, unit in enumerate(units)}
    failures = []

    def finished(number: int, found: vgtjax.Calibration | SimulationError) -> None:
        if isinstance(found, SimulationError):
            failures.append(number)
        else:
            scores.append(scores_of(found, units[number]))

    run_together(fits, finished)
    seconds = (time.perf_counter() - began) / CAMPAIGNS
    errors = np.array(scores)
    known = np.isfinite(errors)
    held = np.where(known, np.abs(errors) <= scipy.stats.norm.ppf(0.975), np.nan)
    return (
        fault.name,
        f"{100 * np.nanmean(held):.1f} %",
        f"{100 * np.min(np.nanmean(held, axis=0)):.0f} %",
        f"{100 * np.mean(known):.0f} %",
        f"{np.max(np.abs(np.nanmean(errors, axis=0))):.2f}",
        str(len(failures)),
        f"{seconds:.1f} s",
    )


def fitting(traces: list[vgtjax.Trace]) -> Steps[vgtjax.Calibration]:
    """A fit as the command line has it, as a computation."""
    calibrator = yield from starting_fit(plan_fit(vgtjax.Actuator(), traces))
    return (yield from calibrator.steps())


def scores_of(found: vgtjax.Calibration, unit: vgtjax.Actuator) -> np.ndarray:
    """Errors in standard errors, those of positive values by their logarithm; NaN where there is no interval.

    Of the stops, which no plant of these campaigns varies, nothing is counted.
    """
    selection = found.task.selection
    truth = np.asarray(found.transform.to_coordinates(np.append(np.asarray(selection.pack(unit)), found.duty_delay)))
    errors = (np.asarray(found.progress.coordinates) - truth)[:-1] / found.uncertainty.std_errors
    counted = [not entry.startswith("diaphragm.stop") for entry in selection.entries]
    return errors[counted]
