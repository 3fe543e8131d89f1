"""How often the intervals of a fit hold the truth, over campaigns of random actuators whose parameters are known."""

import time

import numpy as np
import scipy.stats

import vgtjax

from ..campaigns import FAULTS, Fault, draw_unit, record
from ..table import Section

CAMPAIGNS = 25
"""Of each fault: 10 s each on two cores."""
SEED = 2012


def measure() -> Section:
    """Fits every campaign as the command line would, without a word on what is wrong with it."""
    section = Section(
        "Do 95 % intervals hold the truth?",
        f"{CAMPAIGNS} actuators for each fault, 31 s at 1 kHz each, simulated by the hard-switching plant of these "
        "benchmarks (RK4, 10 us); all that a study frees by default is fitted, and nothing is said of the fault.",
        ("what is wrong", "hold the truth", "least of an entry", "has an interval", "largest mean error", "a fit"),
    )
    for number, fault in enumerate(FAULTS):
        section.add(*_measure(fault, SEED + number))
    section.notes.append(
        "Least of an entry: the lowest share of one entry; of 25 intervals, honest ones rarely miss more than four. "
        "Largest mean error: the mean over campaigns, in standard errors, of the entry where it is largest."
    )
    return section


def _measure(fault: Fault, seed: int) -> tuple[str, ...]:
    """A row of the table."""
    rng, scores, seconds = np.random.default_rng(seed), [], []
    for _ in range(CAMPAIGNS):
        unit = draw_unit(rng)
        traces, began = record(unit, rng, fault), time.perf_counter()
        scores.append(_scores(vgtjax.fit(vgtjax.Actuator(), traces), unit))
        seconds.append(time.perf_counter() - began)
    errors = np.array(scores)
    known = np.isfinite(errors)
    held = np.where(known, np.abs(errors) <= scipy.stats.norm.ppf(0.975), np.nan)
    return (
        fault.name,
        f"{100 * np.nanmean(held):.1f} %",
        f"{100 * np.min(np.nanmean(held, axis=0)):.0f} %",
        f"{100 * np.mean(known):.0f} %",
        f"{np.max(np.abs(np.nanmean(errors, axis=0))):.2f}",
        f"{np.median(seconds):.1f} s",
    )


def _scores(found: vgtjax.Calibration, unit: vgtjax.Actuator) -> np.ndarray:
    """Errors in standard errors, those of positive values by their logarithm; NaN where there is no interval.

    Of the stops, which no plant of these campaigns varies, nothing is counted.
    """
    selection = found.task.selection
    truth = np.asarray(found.transform.to_coordinates(np.append(np.asarray(selection.pack(unit)), found.duty_delay)))
    errors = (np.asarray(found.progress.coordinates) - truth)[:-1] / found.uncertainty.std_errors
    counted = [not entry.startswith("diaphragm.stop") for entry in selection.entries]
    return errors[counted]
