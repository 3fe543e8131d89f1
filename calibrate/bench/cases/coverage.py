"""How often the intervals of a fit hold the truth, over campaigns of random actuators whose parameters are known."""

import functools
import pathlib
import time

import numpy as np
import scipy.stats
from jaxtyping import Float

import vgtjax
from vgtjax import SimulationError
from vgtjax.estimation import Steps, run_together
from vgtjax.identification import plan_fit, starting_fit

from ..campaigns import FAULTS, Fault, draw_unit, record
from ..kept import Cells, KeptRows
from ..table import Section

GROUPS, CAMPAIGNS = 4, 25
"""Of each fault, and in a group: derivatives of as many fill a few gigabytes."""
SEED = 5000
LEAST, CHANCE = 0.90, 0.01
"""An entry whose intervals hold the truth less often than the first by more than chance is named."""


_ABOUT = (
    f"{GROUPS * CAMPAIGNS} actuators for each fault, 31 s at 1 kHz each, simulated by the hard-switching plant of "
    "these benchmarks (RK4, 10 us); all that a study frees by default is fitted, and nothing is said of the fault."
)


def measure(keep: pathlib.Path | None = None) -> Section:
    """Fits every campaign as the command line would, without a word on what is wrong with it.

    **Arguments:** `keep`: a file for the errors of finished groups, from which another call goes on.
    """
    section = Section(
        "Do 95 % intervals hold the truth?",
        _ABOUT,
        (
            "what is wrong",
            "hold the truth",
            "least of an entry",
            "entries below 90 %",
            "has an interval",
            "largest mean error",
            "failed",
            "each",
        ),
    )
    kept = KeptRows(keep, _ABOUT)
    for number, fault in enumerate(FAULTS):
        section.add(*_measure(fault, SEED + 10 * number, kept))
    section.notes.append(
        "Hold the truth: of the entries that have an interval, of fits that converged; others count as failed. "
        f"Entries below 90 %: those that held it so rarely that chance does it less than once in {1 / CHANCE:g}. "
        "Largest mean error: the mean over campaigns, in standard errors, of the entry where it is largest. Each: wall "
        "time of a campaign and its fit, as many side by side as there are cores."
    )
    return section


def _measure(fault: Fault, seed: int, kept: KeptRows) -> Cells:
    """A row of the table."""
    groups = [
        kept.row(f"{fault.name}, seed {seed + group}", functools.partial(_group, fault, seed + group))
        for group in range(GROUPS)
    ]
    errors = [[float(error) for error in campaign.split()] for _, *campaigns in groups for campaign in campaigns]
    seconds = sum(float(group[0]) for group in groups) / (GROUPS * CAMPAIGNS)
    return (fault.name, *summary_of(np.array(errors)), str(GROUPS * CAMPAIGNS - len(errors)), f"{seconds:.1f} s")


def _group(fault: Fault, seed: int) -> Cells:
    """What is kept of a group: its wall time in s, then each usable fit's errors in standard errors."""
    began, rng, errors = time.perf_counter(), np.random.default_rng(seed), []
    units = [draw_unit(rng) for _ in range(CAMPAIGNS)]

    def finished(number: int, found: vgtjax.Calibration | SimulationError) -> None:
        if not isinstance(found, SimulationError) and found.converged:
            errors.append(" ".join(f"{error:.4f}" for error in scores_of(found, units[number])))

    run_together({number: fitting(record(unit, rng, fault)) for number, unit in enumerate(units)}, finished)
    return (f"{time.perf_counter() - began:.1f}", *errors)


def summary_of(errors: Float[np.ndarray, "campaigns entries"]) -> tuple[str, ...]:
    """The share of intervals that hold the truth, its least over entries, how many entries are below what is asked for,
    the share of entries with an interval, and the largest mean error."""
    known = np.isfinite(errors)
    held = known & (np.abs(np.where(known, errors, np.inf)) <= scipy.stats.norm.ppf(0.975))
    counts, tried = held.sum(axis=0), known.sum(axis=0)
    rarely = scipy.stats.binom.cdf(counts, tried, LEAST) < CHANCE
    return (
        f"{100 * held.sum() / known.sum():.1f} %",
        f"{100 * np.min(counts / tried):.0f} %",
        str(np.sum(rarely)),
        f"{100 * np.mean(known):.0f} %",
        f"{np.max(np.abs(np.nanmean(np.where(known, errors, np.nan), axis=0))):.2f}",
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
