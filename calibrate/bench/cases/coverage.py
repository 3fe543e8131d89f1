"""How often the intervals of a fit hold the truth, over campaigns of random actuators whose parameters are known."""

import functools
import pathlib
import time

import numpy as np
import scipy.stats
from jaxtyping import Float, Int

import vgtjax
from vgtjax import SimulationError
from vgtjax.estimation import Computation, run_together
from vgtjax.identification import plan_fit, starting_fit
from vgtjax.parameters import parameter_table, select

from ..campaigns import FAULTS, Fault, draw_unit, record
from ..kept import Cells, KeptRows
from ..table import Section

GROUPS, CAMPAIGNS = 4, 25
"""Of each fault, and in a group: derivatives of as many fill a few gigabytes."""
SEED = 5000
ROD = "nothing; the rod alone, driven by its measured pressure"
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
        section.add(*_measure(fault.name, vgtjax.Actuator(), fault, SEED + 10 * number, kept))
    section.add(*_measure(ROD, vgtjax.MechanicalActuator(), FAULTS[0], SEED, kept))
    section.notes.append(
        "Hold the truth: of the entries that have an interval, of fits that converged; others count as failed. "
        f"Entries below 90 %: those that held it so rarely that chance does it less than once in {1 / CHANCE:g}. "
        "Largest mean error: the mean over campaigns, in standard errors, of the entry where it is largest. Each: wall "
        "time of a campaign and its fit, as many side by side as there are cores."
    )
    return section


def _measure(name: str, model: vgtjax.AbstractModel, fault: Fault, seed: int, kept: KeptRows) -> Cells:
    """A row of the table."""
    groups = [
        kept.row(f"{name}, seed {seed + group}", functools.partial(_group, model, fault, seed + group))
        for group in range(GROUPS)
    ]
    errors = [[float(error) for error in campaign.split()] for _, *campaigns in groups for campaign in campaigns]
    seconds = sum(float(group[0]) for group in groups) / (GROUPS * CAMPAIGNS)
    return (name, *summary_of(np.array(errors)), str(GROUPS * CAMPAIGNS - len(errors)), f"{seconds:.1f} s")


def _group(model: vgtjax.AbstractModel, fault: Fault, seed: int) -> Cells:
    """What is kept of a group: its wall time in s, then each usable fit's errors in standard errors."""
    began, rng, errors = time.perf_counter(), np.random.default_rng(seed), []
    units = [draw_unit(rng) for _ in range(CAMPAIGNS)]

    def finished(number: int, found: vgtjax.Calibration | SimulationError) -> None:
        if not isinstance(found, SimulationError) and found.converged:
            errors.append(" ".join(f"{error:.4f}" for error in scores_of(found, units[number])))

    run_together({number: fitting(record(unit, rng, fault), model) for number, unit in enumerate(units)}, finished)
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


def fitting(traces: list[vgtjax.Trace], model: vgtjax.AbstractModel | None = None) -> Computation[vgtjax.Calibration]:
    """A fit as the command line has it, as a computation; of the printed actuator, if nothing else is given."""
    calibrator = yield from starting_fit(plan_fit(vgtjax.Actuator() if model is None else model, traces))
    return (yield from calibrator.steps())


def counted_entries(found: vgtjax.Calibration, unit: vgtjax.Actuator) -> Int[np.ndarray, " counted"]:
    """Which entries of a fit are counted: what the plant has too, but for the stops, which no plant of these campaigns
    varies."""
    known, entries = parameter_table(unit), found.task.selection.entries
    counted = [entry.partition("[")[0] in known and not entry.startswith("diaphragm.stop") for entry in entries]
    return np.flatnonzero(counted)


def scores_of(found: vgtjax.Calibration, unit: vgtjax.Actuator) -> Float[np.ndarray, " counted"]:
    """Errors of what is counted in standard errors, those of positive values by their logarithm; NaN where there is no
    interval."""
    counted, entries = counted_entries(found, unit), found.task.selection.entries
    here = np.asarray(found.progress.coordinates)
    truth = np.append(found.values, np.zeros(len(here) - len(found.values)))
    truth[counted] = select(unit, [entries[each] for each in counted]).values(unit)
    errors = here - np.asarray(found.transform.to_coordinates(truth))
    return errors[counted] / found.uncertainty.std_errors[counted]
