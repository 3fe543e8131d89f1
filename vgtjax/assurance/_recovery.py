"""Known-truth recovery on one's own traces: a fitted model simulates them with new noise, and all are fitted again."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from jaxtyping import Float

from .._errors import InputError
from .._printing import Cells, Printed
from ..estimation import (
    CHANNELS,
    NORMAL_95,
    Calibrator,
    Computation,
    LevenbergMarquardt,
    SensorsOfTraces,
    Slopes,
    Task,
    first_progress,
    learn_sensors,
    observe_traces,
    sharp_bundles,
    starting,
    white_sensors,
)
from ..parts import with_sharp_seat
from ..traces import Trace

CANNOT_SHOW = (
    "this cannot show a wrong structure (another law of friction or vane force), a gain of a sensor that is off, or a "
    "held value that is wrong, as the campaigns have the same, nor how well a search from the study's start values "
    "ends or finds out that the duty is late, as each campaign begins at the truth and with what was found"
)
BURN_IN = 2000
"""Samples after which a coloured noise has forgotten how it began."""
SIGNIFICANT = 0.01
"""Probability below which intervals that hold the truth so seldom are not those of 95 %."""
BIASED = 4.0
"""Standard errors of a mean from which a bias is one: by chance in one parameter of sixteen thousand."""

UNFITTED_NOISE, UNFITTED_PART = 10.0, 0.05
"""What a model leaves over, in noise and in standard deviations of a signal, from which it was not fitted. Noise behind
40 Hz is ten times what neighbouring samples show, and is not seen in what moves."""

Table = Float[np.ndarray, "campaigns entries"]


@dataclasses.dataclass(frozen=True, eq=False)
class Truth:
    """What campaigns are simulated from: the traces with the duty that reached the valve, without numerical errors, and
    what is known of the sensors that recorded them."""

    task: Task
    clean: Sequence[Float[np.ndarray, "_ channel"]]
    sensors: SensorsOfTraces
    slopes: Slopes
    """Derivatives over all places that the errors of the traces leave possible around the truth, where every fit
    begins."""
    delay: float = 0.0
    """s by which the duty is late in all traces."""

    @staticmethod
    def of(task: Task, applied: Sequence[Trace], delay: float = 0.0) -> Computation["Truth"]:
        """As a computation: the model of a task as the truth of its traces.

        **Arguments:** `applied`: the traces of the task, with the duty that reached the valve; `delay`: the s by which
        it was late in all of them.

        **Raises:** `InputError` where a model is so far from the traces that it was not fitted to them.
        """
        sharp = sharp_bundles(task.model, applied, task.stepping)
        observed = yield from observe_traces(with_sharp_seat(task.model), sharp, task.fit)
        pairs = zip(task.fit, applied, observed, strict=True)
        clean = [seen[read.rows_at(trace.time)] for trace, read, seen in pairs]
        sensors = learn_sensors(task.fit, task.channels, clean, clean, task.unknown)
        _check_fitted(task, sensors)
        calibrator = yield from starting(task, first_progress(task, delay))
        began = yield from _begun(calibrator, calibrator.sensors)
        placed = (yield from began.correcting()) or began
        slopes = (yield from placed.linearised_around()).minimiser.slopes
        return Truth(task, clean, sensors, slopes, delay)

    def campaign(self, number: int, seed: int) -> Task:
        """The same task with new noise on what the truth gives, on a pressure that drives it, and on what is known of
        values beforehand."""
        rng = np.random.default_rng([seed, number])
        traces = [
            _recorded(trace, clean, known, rng)
            for trace, clean, known in zip(self.task.fit, self.clean, self.sensors, strict=True)
        ]
        sensors = self.task.inputs or [None] * len(traces)
        again = [
            trace if sensor is None else sensor.again(trace, rng) for trace, sensor in zip(traces, sensors, strict=True)
        ]
        return dataclasses.replace(_known_again(self.task, rng), fit=again, validate=[])


def _known_again(task: Task, rng: np.random.Generator) -> Task:
    """A task with what its priors are about when all that told them is done once more, and its values are true; as wide
    as they were in what moves."""
    prior, transform, entries = task.prior, task.transform({}), task.selection.entries
    if prior is None:
        return task
    precision = prior.precision[: len(entries)]
    truth = np.asarray(transform.to_coordinates(task.selection.values(task.model)))
    errors = rng.standard_normal(len(entries)) / np.where(precision > 0, precision, np.inf)
    drawn, slope = (np.asarray(of(truth + errors)) for of in (transform.to_physical, transform.slope))
    known = [place for place, each in enumerate(precision) if each > 0]
    widths = {entries[place]: float(abs(slope[place]) / precision[place]) for place in known}
    centers = {entries[place]: float(drawn[place]) for place in known}
    return dataclasses.replace(task, centers=centers, deviations={**task.deviations, **widths})


def _check_fitted(task: Task, sensors: SensorsOfTraces) -> None:
    """What a model leaves over counts as noise, which nothing would be seen behind."""
    for trace, known, plain in zip(task.fit, sensors, white_sensors(task.fit, task.channels), strict=True):
        for name, sensor in known.items():
            times, part = sensor.level / plain[name].level, sensor.level / np.std(plain[name].values)
            if times > UNFITTED_NOISE and part > UNFITTED_PART:
                raise InputError(
                    f"{trace.name}: a recovery needs a model that was fitted to its traces, but this one leaves "
                    f"{part:.0%} of the movement of {name} over, {times:.0f} times its noise; fit it first, and give "
                    "what was found, or compare structures where it was",
                    "traces",
                )


def _recorded(trace: Trace, clean: np.ndarray, sensors: dict, rng: np.random.Generator) -> Trace:
    """What the sensors of a trace would say of the truth: their offsets, their noise and its memory."""
    new = {}
    for name, sensor in sensors.items():
        sampled = trace.sampled(name)
        assert sampled is not None, "a sensor has samples"
        values = clean[trace.rows(name), CHANNELS.index(name)]
        white = rng.normal(0.0, sensor.deviation, BURN_IN + len(values))
        noise = scipy.signal.lfilter([1.0], np.concatenate([[1.0], -sensor.memory]), white)[BURN_IN:]
        new[name] = dataclasses.replace(sampled, value=values + np.median(sampled.value - values) + noise)
    return trace.replace(**new)


@dataclasses.dataclass(frozen=True)
class Refit:
    """What came of one campaign: coordinates and their standard errors, `None` for what the fit does not stand behind;
    `verdict` says how it ended."""

    number: int
    converged: bool
    verdict: str
    coordinates: tuple[float, ...] = ()
    errors: tuple[float | None, ...] = ()


def refitting(truth: Truth, number: int, seed: int) -> Computation[Refit]:
    """One campaign simulated and fitted, as a computation, from the truth on: so near an end that no search goes before
    the full linear steps that end every fit. These take the derivatives of the truth, as those of any fit, up to three
    standard errors away from where they are from. Sensors are known as the fit of the traces left them until the first
    step has learned them again: noise behind a filter would else look like a model that lacks something. A duty that
    was found to be late is so here from the first step on, and nothing else is asked of it."""
    task = truth.campaign(number, seed)
    calibrator = yield from starting(task, first_progress(task, truth.delay), slopes=truth.slopes)
    if task.unknown.anything:
        calibrator = yield from _begun(calibrator, _known_sensors(task, truth.sensors))
        if truth.delay:
            calibrator = (yield from calibrator.correcting()) or calibrator
    calibration = yield from calibrator.steps()
    count = len(calibration.values)
    errors = [error if np.isfinite(error) else None for error in calibration.uncertainty.std_errors.tolist()]
    coordinates = calibration.progress.coordinates[:count]
    return Refit(number, calibration.converged, calibration.verdict, coordinates, tuple(errors))


def _begun(calibrator: Calibrator, sensors: SensorsOfTraces) -> Computation[Calibrator]:
    """Where a search by these sensors would have ended: what follows are full linear steps, with the derivatives that
    are known."""
    search, task = calibrator.minimiser, calibrator.task
    progress = dataclasses.replace(search.progress, converged=True).linearised_around(search.slopes.around)
    problem = search.problem.with_sensors(task.traces, sensors)
    began = yield from LevenbergMarquardt.begin(problem, progress, search.corrected_later, search.slopes)
    return dataclasses.replace(calibrator, sensors=sensors, minimiser=began)


def _known_sensors(task: Task, known: SensorsOfTraces) -> SensorsOfTraces:
    """Sensors of new traces with the noise that is known of them, and no outlier."""
    return [
        {
            name: dataclasses.replace(white, deviation=sensors[name].deviation, memory=sensors[name].memory)
            for name, white in plain.items()
        }
        for plain, sensors in zip(white_sensors(task.traces, task.channels), known, strict=True)
    ]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Recovery(Printed):
    """What many campaigns of a known truth say of a fit's estimates and errors.

    `estimates` and `errors` `(campaigns, entries)` are coordinates: logarithms of positive entries, others in units of
    their size; errors are NaN for what was not determined. `truth` has the coordinates that were simulated.
    """

    entries: Sequence[str]
    truth: Float[np.ndarray, " entries"]
    scale: Float[np.ndarray, " entries"]
    """By what a coordinate's error is multiplied to be one in the unit of the table."""
    estimates: Table
    errors: Table
    failed: Sequence[str]

    @staticmethod
    def of(task: Task, refits: Sequence[Refit]) -> "Recovery":
        """All campaigns of a task; those that did not converge are named, and don't count."""
        transform = task.transform({})
        truth = np.asarray(transform.to_coordinates(task.selection.values(task.model)))
        good = [each for each in refits if each.converged]
        return Recovery(
            task.selection.entries,
            truth,
            np.asarray(transform.slope(truth)),
            np.array([each.coordinates for each in good], float).reshape(len(good), len(truth)),
            np.array([each.errors for each in good], float).reshape(len(good), len(truth)),
            [f"campaign {each.number}: {each.verdict}" for each in refits if not each.converged],
        )

    @property
    def known(self) -> Float[np.ndarray, " entries"]:
        """In how many campaigns each entry was determined."""
        return np.isfinite(self.errors).sum(axis=0).astype(float)

    @property
    def coverage(self) -> Float[np.ndarray, " entries"]:
        """Part of the 95 % intervals that hold the truth, of those that were given; NaN for none."""
        held = np.abs(self._missed) <= NORMAL_95 * self.errors
        return _mean(np.where(np.isfinite(self.errors), held, np.nan))

    @property
    def scores(self) -> Table:
        """Errors of all estimates in their standard errors; NaN for what was not determined."""
        return self._missed / self.errors

    @property
    def bias(self) -> Float[np.ndarray, " entries"]:
        """Mean error in units of the table."""
        return self.scale * _mean(self._missed)

    @property
    def spread(self) -> Float[np.ndarray, " entries"]:
        """Standard deviation of the estimates in units of the table; NaN for an entry that one campaign determined."""
        more = np.where(self.known > 1, self.known - 1, np.nan)
        return self.scale * np.sqrt(_mean(np.square(self._missed - _mean(self._missed))) * self.known / more)

    @property
    def claimed(self) -> Float[np.ndarray, " entries"]:
        """Median of the standard errors that the fits claim, in units of the table."""
        some = np.any(np.isfinite(self.errors), axis=0)
        return self.scale * np.where(some, np.nanmedian(np.where(some, self.errors, 0.0), axis=0), np.nan)

    @property
    def total(self) -> float:
        """Part of all intervals that hold the truth."""
        return float(np.nansum(self.coverage * self.known) / max(self.known.sum(), 1.0))

    @property
    def sentences(self) -> list[str]:
        """What the campaigns say of the claims, in words."""
        campaigns, known = len(self.estimates), self.known
        said = [f"{100 * self.total:.1f} % of {known.sum():.0f} intervals of 95 % hold the truth"]
        held = np.nan_to_num(self.coverage * known)
        chance = scipy.stats.binom.cdf(np.round(held), known, 0.95)
        for at in np.flatnonzero((known > 0) & (chance < SIGNIFICANT)).tolist():
            part = f"{held[at]:.0f} of {known[at]:.0f}"
            said.append(f"{self.entries[at]}: only {part} intervals hold the truth, so its errors are too small")
        off = np.abs(self.bias) * np.sqrt(known) / np.where(self.spread > 0, self.spread, np.inf)
        for at in np.flatnonzero(off > BIASED).tolist():
            part = self.bias[at] / self.claimed[at]
            said.append(f"{self.entries[at]}: estimates are off by {part:+.2f} of their standard error in the mean")
        for at in np.flatnonzero(known < campaigns).tolist():
            said.append(f"{self.entries[at]}: determined in {known[at]:.0f} of {campaigns} campaigns")
        return [*said, CANNOT_SHOW]

    def _title(self) -> str:
        return f"Recovery: {len(self.estimates)} campaigns of a known truth, {len(self.failed)} more did not converge"

    def _tables(self) -> list[Cells]:
        rows = [("parameter", "mean error", "spread", "claimed", "coverage", "determined")]
        columns = (self.bias, self.spread, self.claimed, self.coverage, self.known)
        for entry, bias, spread, claimed, coverage, known in zip(self.entries, *columns, strict=True):
            figures = (f"{each:.3g}" for each in (bias, spread, claimed))
            rows.append((entry, *figures, f"{100 * coverage:.0f} %", f"{known:.0f}"))
        return [rows]

    def _sentences(self) -> list[str]:
        return self.sentences

    @property
    def _missed(self) -> Table:
        return np.where(np.isfinite(self.errors), self.estimates - self.truth, np.nan)


def _mean(values: Table) -> Float[np.ndarray, " entries"]:
    """Mean over campaigns of what is a number; NaN where none is."""
    count = np.isfinite(values).sum(axis=0)
    return np.where(count > 0, np.nansum(values, axis=0) / np.maximum(count, 1), np.nan)
