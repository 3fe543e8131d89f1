"""What comes of a calibration that has ended: values, their covariance, and every trace simulated with them."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from .._kept import keep_compiled
from .._types import Coordinates
from ..parameters import Selection
from ..plants import bare
from ..simulation import first_failure
from ._calibration import Calibration
from ._comparison import comparing
from ._found import found_besides, traces_met
from ._least_squares import LeastSquares, finite_columns, least_squares, windowed_gram
from ._task import Task
from .derivatives import CHANNELS, Computation, ask, bundle_traces
from .errors import Bands, Budget, by_gains, predicted_spread, uncertain_gains
from .measurements import SensorsOfTraces, turns
from .search import LevenbergMarquardt

WINDOW = 0.25
"""s after which residuals should have forgotten each other: a rod's answer to a step of the duty is over then."""
WINDOWS = 4
"""Windows for each unknown that traces should have at least: with fewer they are shorter."""

AS_LIKELY = 0.5
"""That of two readings of a duty which meet the traces the other one is right."""

_unpack = keep_compiled(Selection.unpack)

EXPERIMENTS, SEED = 5, 0
"""Of fresh noise on a driving pressure; with five, a standard error from four traces is good to a sixth."""

Covariance = Float[np.ndarray, "entries entries"]


@dataclasses.dataclass(frozen=True)
class Lacking:
    """What the errors of a search lack, as moves of the coordinates: one along a `delay` that is answered less than
    promised, and one row for each of the `directions` that slow traces answer less."""

    delay: Coordinates
    directions: Float[np.ndarray, "directions coordinates"]


HOLD, DRIVE, SLOW = "hold of the duty", "sensor of the drive", "derivatives of slow traces"
"""Sources of errors, beside gains and tolerances, as a budget names them."""


def finishing(
    task: Task, search: LevenbergMarquardt, sensors: SensorsOfTraces, notes: tuple[str, ...], lacking: Lacking
) -> Computation[Calibration]:
    """The result, as a computation."""
    problem, progress, transform = search.problem, search.progress, search.problem.transform
    everything, count = search.uncertainty(), len(task.selection.entries)
    coordinates = np.asarray(progress.coordinates)
    found, slope = np.asarray(transform.to_physical(coordinates)), np.asarray(transform.slope(coordinates))
    beside = {name: np.where(everything.estimable, rows, 0.0) for name, rows in (yield from _beside(task, search))}
    beside |= {SLOW: np.where(everything.estimable, lacking.directions, 0.0)}
    uncertainty = everything.first(count)
    wanted = np.array(progress.wanted).reshape(-1, len(coordinates))
    restless = np.sqrt(np.diag(_scatter(everything, wanted)))[-1:]
    scatter = _scatter(uncertainty, wanted[:, :count]) + np.outer(lacking.delay[:count], lacking.delay[:count])
    window, windowed = _by_windows(task, search, everything)
    moved = {name: _as_one(name, rows[:, :count]) for name, rows in beside.items() if len(rows)}
    budget = _budget(uncertainty, scatter, moved, slope[:count], windowed[:count], window)
    rows = np.concatenate([*beside.values()])
    more = scatter + rows[:, :count].T @ rows[:, :count]
    uncertainty = dataclasses.replace(uncertainty, covariance=uncertainty.covariance + more)
    values = task.inside(found[:count])
    model = _unpack(task.selection, task.model, values)
    late = task.late_duty and progress.coordinates[-1] != 0.0
    delay = float(found[-1]) if late else 0.0
    of_delay = slope[-1] * np.linalg.norm([everything.std_errors[-1], lacking.delay[-1], *rows[:, -1], *restless])
    # What traces hardly answer leaves them as they are, as do both readings of the duty that meet them, whatever a
    # linear model says of it.
    unfelt = np.concatenate([beside[HOLD], beside[SLOW]])[:, :count]
    errors = yield from _bands(task, search, uncertainty.covariance - unfelt.T @ unfelt, lacking.delay)
    with np.errstate(over="ignore"):  # the error of a value that ran away may be beyond every number
        covariance = uncertainty.covariance * np.outer(slope[:count], slope[:count])
    calibration = Calibration(
        model=bare(model),
        task=task,
        transform=transform,
        progress=progress,
        values=values,
        covariance=covariance,
        uncertainty=uncertainty,
        traces=(yield from comparing(task, model, delay, sensors, errors)),
        count=problem.count,
        sensors=sensors,
        budget=budget,
        duty_delay=delay,
        duty_delay_error=float(of_delay) if late else None,
        notes=notes,
    )
    return dataclasses.replace(calibration, findings=(*found_besides(calibration), traces_met(calibration)))


Rows = Float[np.ndarray, "moves coordinates"]
"""By how much coordinates move, whose products with themselves add up to a covariance."""


def _beside(task: Task, search: LevenbergMarquardt) -> Computation[Iterable[tuple[str, Rows]]]:
    """What moves the end of a search beside the noise of what was fitted, by the source."""
    moved = {**_moved_by_gains(task, search), **(yield from _moved_by_tolerances(task, search))}
    found = {name: each[None] for name, each in moved.items()}
    found[HOLD], progress = np.zeros((0, len(search.progress.coordinates))), search.progress
    if progress.otherwise:
        apart = np.array(progress.otherwise) - np.asarray(progress.coordinates)
        found[HOLD] = apart[None] * np.sqrt(AS_LIKELY)
    return {**found, DRIVE: (yield from _moved_by_inputs(task, search))}.items()


def _as_one(name: str, rows: Rows) -> Coordinates:
    """How far coordinates move by a source; with a sign, if it moves them one way."""
    return np.linalg.norm(rows, axis=0) if name in (DRIVE, SLOW) else rows[0]


def _budget(
    uncertainty: LeastSquares,
    scatter: Covariance,
    moved: dict[str, np.ndarray],
    slope: Float[np.ndarray, " entries"],
    windowed: Float[np.ndarray, " entries"],
    window: float,
) -> Budget:
    """Parts of the errors in the units of the table, by the slope of these with respect to coordinates."""

    def in_units(errors: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore"):  # of a value that ran away
            return np.where(uncertainty.estimable, slope * errors, np.nan)

    noise, restless = (np.sqrt(np.diag(each)) for each in (uncertainty.covariance, scatter))
    sources = {name: in_units(each) for name, each in moved.items()}
    return Budget(in_units(noise), in_units(restless), sources, in_units(windowed), window)


def _by_windows(
    task: Task, search: LevenbergMarquardt, found: LeastSquares
) -> tuple[float, Float[np.ndarray, " coordinates"]]:
    """A length in s of windows that forget each other, and errors of coordinates by sums over these: a sandwich.

    What is known beforehand has its own variance, and no time.
    """
    problem, point = search.problem, search.point
    owner = problem.owner
    columns, before = finite_columns(point.columns)[: len(owner)], point.columns[len(owner) :]
    scores = (columns * point.residuals[: len(owner), None]).reshape(-1, len(CHANNELS), columns.shape[1]).sum(axis=1)
    samples = owner[:: len(CHANNELS)]
    spans = np.array([float(np.ptp(trace.time)) for trace in task.fit])
    intervals = spans / np.maximum(np.bincount(samples, minlength=len(spans)) - 1, 1)
    window = min(WINDOW, float(np.sum(spans)) / (WINDOWS * columns.shape[1]))
    lengths = np.maximum(1, np.round(window / intervals)).astype(int)
    few, bread = point.reduced, found.covariance / max(found.scale, 1e-300)
    if point.known:  # a covariance is no inverse then that is scaled
        bread = least_squares(few.columns, few.residuals).covariance
    with np.errstate(over="ignore", invalid="ignore"):  # of a value that ran away
        # Scores are of any size, where derivatives explode, and what they move coordinates by is not.
        moved, known = scores @ bread, before @ bread
        gram = windowed_gram(moved, samples, lengths) + known.T @ known
        return float(np.median(lengths * intervals)), np.sqrt(np.maximum(np.diag(gram), 0.0))


def _scatter(uncertainty: LeastSquares, wanted: Float[np.ndarray, "steps entries"]) -> Covariance:
    """Corrections that go to and fro say how well the numbers themselves are known: by the steps since the first turn,
    or by the last one."""
    if not len(wanted):
        return np.zeros_like(uncertainty.covariance)
    wanted = np.where(uncertainty.estimable, wanted, 0.0)
    first = turns(wanted / np.where(uncertainty.estimable, uncertainty.std_errors, 1.0))[:1]
    last = wanted[int(first[0]) :] if len(first) else wanted[-1:]
    return last.T @ last / len(last)


Moved = dict[str, Coordinates]
"""By how much coordinates move, by the source."""


def _moved_by_gains(task: Task, search: LevenbergMarquardt) -> Moved:
    """How far every coordinate moves when a sensor shows too much by the uncertainty of its gain, to first order."""
    if not uncertain_gains(task):
        return {}
    columns = search.problem.whitened([by_gains(task, lanes) for lanes in search.slopes.evaluated.observed])
    names = [f"gain of {channel}" for channel in uncertain_gains(task)]
    return {name: _followed(search, column) for name, column in zip(names, columns.T, strict=True)}


def _moved_by_tolerances(task: Task, search: LevenbergMarquardt) -> Computation[Moved]:
    """By how much every coordinate moves when one that is held moves by its tolerance, to first order."""
    if not task.tolerances:
        return {}
    held = yield from search.slopes.held(search.problem, list(task.tolerances))
    columns = search.problem.whitened(held)[:, : len(task.tolerances)].T
    pairs = zip(task.tolerances.items(), columns, strict=True)
    return {entry: -_followed(search, size * column) for (entry, size), column in pairs}


def _followed(search: LevenbergMarquardt, change: Float[np.ndarray, " rows"]) -> Coordinates:
    """How far coordinates move where what is measured changes, in units of the noise."""
    columns = finite_columns(search.point.columns)
    return least_squares(columns, np.append(change, np.zeros(len(columns) - len(change)))).values


def _moved_by_inputs(task: Task, search: LevenbergMarquardt) -> Computation[Rows]:
    """How far every coordinate moves, to first order, when the pressure that drives a trace is measured once more: one
    row for each trace and experiment, whose products add up to a covariance.

    **Raises:** `SimulationError` for a trace of which no experiment can be simulated; where some can't, others count.
    """
    problem, owner = search.problem, search.problem.owner
    here, rng = np.asarray(search.progress.coordinates), np.random.default_rng(SEED)
    if not any(task.inputs):
        return np.zeros((0, len(here)))
    asked = problem.evaluation(here)
    before, moves = (yield from ask(asked)), [list[Coordinates]() for _ in task.traces]
    for _ in range(EXPERIMENTS):
        traces = [
            trace if sensor is None else sensor.again(trace, rng)
            for trace, sensor in zip(task.traces, task.inputs, strict=True)
        ]
        bundles = bundle_traces(task.model, traces, task.steps)
        after = yield from ask(dataclasses.replace(asked, bundles=bundles))
        change = problem.residuals_of(after.observed) - problem.residuals_of(before.observed)
        for number, end in enumerate(after.results(bundles)):
            if not first_failure(end):
                moves[number].append(_followed(search, np.where(owner == number, change, 0.0)))
    if lost := [trace.name for trace, mine in zip(task.traces, moves, strict=True) if not mine]:
        raise SimulationError(
            f"{', '.join(lost)} can't be simulated with a drive that is measured once more: {after.failure}"
        )
    return np.concatenate([np.array(mine) / np.sqrt(len(mine)) for mine in moves])


def _bands(task: Task, search: LevenbergMarquardt, covariance: Covariance, lacking: Coordinates) -> Computation[Bands]:
    """Standard errors of what is observed of all traces, by the covariance of the coordinates of the entries, and by
    what that of all `lacking` coordinates has more.

    Derivatives are those that told the covariance, and from where they are: what traces tell of a sum is far more than
    of its parts, and other derivatives, though as good, would not cancel.
    """
    everything, count = search.uncertainty().covariance + np.outer(lacking, lacking), len(covariance)
    everything[:count, :count] = covariance
    scale = np.asarray(search.problem.transform.slope(search.slopes.at))
    with np.errstate(over="ignore", invalid="ignore"):  # of a value that ran away
        units = everything * np.outer(scale, scale)
    return (yield from predicted_spread(task, search.problem, search.slopes, units))
