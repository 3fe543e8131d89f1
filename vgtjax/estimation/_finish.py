"""What comes of a calibration that has ended: values, their covariance, and every trace simulated with them."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from .._kept import keep_compiled
from .._types import Coordinates
from ..parameters import Selection
from ..plants import bare
from ._bands import Bands, predicted_spread
from ._budget import Budget
from ._bundle import CHANNELS, bundle_traces
from ._calibration import Calibration, comparing
from ._evaluation import Steps, ask
from ._evidence import turns
from ._found import found_besides, traces_met
from ._granted import by_gains, uncertain_gains
from ._least_squares import LeastSquares, finite_columns, least_squares, windowed_gram
from ._measured import Sensors
from ._search import LevenbergMarquardt
from ._task import Task

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


def finishing(
    task: Task, search: LevenbergMarquardt, sensors: Sensors, notes: tuple[str, ...], lacking: Lacking
) -> Steps[Calibration]:
    """The result, as a computation."""
    problem, progress, transform = search.problem, search.progress, search.problem.transform
    everything, count = search.uncertainty(), len(task.selection.entries)
    coordinates = np.asarray(progress.coordinates)
    found, slope = np.asarray(transform.to_physical(coordinates)), np.asarray(transform.slope(coordinates))
    values = task.inside(found[:count])
    uncertainty = everything.first(count)
    more = _scatter(uncertainty, np.array(progress.wanted)[:, :count]) if progress.wanted else np.zeros((count, count))
    more = more + np.outer(lacking.delay[:count], lacking.delay[:count])
    sources = {**_moved_by_gains(task, search), **(yield from _moved_by_tolerances(task, search))}
    moved = {name: np.where(uncertainty.determined, each[:count], 0.0) for name, each in sources.items()}
    driven = np.where(uncertainty.determined, (yield from _moved_by_inputs(task, search))[:, :count], 0.0)
    apart = np.zeros(count)
    if progress.otherwise:
        other = np.array(progress.otherwise)[:count] - coordinates[:count]
        moved["hold of the duty"] = apart = np.where(uncertainty.determined, other * np.sqrt(AS_LIKELY), 0.0)
    unanswered = np.where(uncertainty.determined, lacking.directions[:, :count], 0.0)
    beside = np.column_stack([np.zeros((count, 0)), *moved.values(), *driven, *unanswered])
    if len(driven):
        moved["sensor of the drive"] = np.linalg.norm(driven, axis=0)
    if len(unanswered):
        moved["derivatives of slow traces"] = np.linalg.norm(unanswered, axis=0)
    window, windowed = _by_windows(task, search, everything)
    budget = _budget(uncertainty, more, moved, slope[:count], windowed[:count], window)
    more = more + beside @ beside.T
    uncertainty = dataclasses.replace(uncertainty, covariance=uncertainty.covariance + more)
    model = _unpack(task.selection, task.model, values)
    late = task.late_duty and progress.coordinates[-1] != 0.0
    delay = float(found[-1]) if late else 0.0
    # What traces hardly answer leaves them as they are, as do both readings of the duty that meet them, whatever a
    # linear model says of it.
    seen = uncertainty.covariance - np.outer(apart, apart) - unanswered.T @ unanswered
    errors = yield from _bands(task, search, seen, lacking.delay)
    compared = yield from comparing(task, model, delay, sensors, errors)
    with np.errstate(over="ignore"):  # the error of a value that ran away may be beyond every number
        covariance = uncertainty.covariance * np.outer(slope[:count], slope[:count])
    calibration = Calibration(
        bare(model),
        task,
        transform,
        progress,
        values,
        covariance,
        uncertainty,
        compared,
        problem.count,
        sensors,
        budget,
        delay,
        float(slope[-1] * np.linalg.norm([everything.std_errors[-1], lacking.delay[-1], *lacking.directions[:, -1]]))
        if late
        else None,
        notes,
    )
    return dataclasses.replace(calibration, findings=(*found_besides(calibration), traces_met(calibration)))


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
            return np.where(uncertainty.determined, slope * errors, np.nan)

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
    interval = float(np.median([trace.longest_interval for trace in task.fit]))
    longest = len(scores) / (WINDOWS * columns.shape[1])
    length = max(1, round(min(WINDOW / interval, longest)))
    bread = found.covariance / max(found.scale, 1e-300)
    with np.errstate(over="ignore", invalid="ignore"):  # of a value that ran away
        # Scores are of any size, where derivatives explode, and what they move coordinates by is not.
        moved, known = scores @ bread, before @ bread
        gram = windowed_gram(moved, owner[:: len(CHANNELS)], length) + known.T @ known
        return length * interval, np.sqrt(np.maximum(np.diag(gram), 0.0))


def _scatter(uncertainty: LeastSquares, wanted: Float[np.ndarray, "steps entries"]) -> Covariance:
    """Corrections that go to and fro say how well the numbers themselves are known: by the steps since the first turn,
    or by the last one."""
    wanted = np.where(uncertainty.determined, wanted, 0.0)
    first = turns(wanted / np.where(uncertainty.determined, uncertainty.std_errors, 1.0))[:1]
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


def _moved_by_tolerances(task: Task, search: LevenbergMarquardt) -> Steps[Moved]:
    """By how much every coordinate moves when one that is held moves by its tolerance, to first order."""
    if not task.tolerances:
        return {}
    held = yield from search.slopes.held(search.problem, list(task.tolerances))
    columns = search.problem.whitened(held)[:, : len(task.tolerances)].T
    pairs = zip(task.tolerances.items(), columns, strict=True)
    return {entry: -_followed(search, size * column) for (entry, size), column in pairs}


def _followed(search: LevenbergMarquardt, change: Float[np.ndarray, " rows"]) -> Coordinates:
    """How far coordinates move where what is measured changes, in units of the noise."""
    rows = np.append(change, np.zeros(len(search.point.columns) - len(change)))
    return least_squares(search.point.columns, rows).values


def _moved_by_inputs(task: Task, search: LevenbergMarquardt) -> Steps[Float[np.ndarray, "moves coordinates"]]:
    """How far every coordinate moves, to first order, when the pressure that drives a trace is measured once more: one
    row for each trace and experiment, whose products add up to a covariance.

    **Raises:** `SimulationError` where no experiment can be simulated; where some can't, the others count.
    """
    problem, owner = search.problem, search.problem.owner
    here, rng = np.asarray(search.progress.coordinates), np.random.default_rng(SEED)
    if not any(task.inputs):
        return np.zeros((0, len(here)))
    asked, moves = problem.evaluation(here), []
    before = yield from ask(asked)
    for _ in range(EXPERIMENTS):
        traces = [
            trace if sensor is None else sensor.again(trace, rng)
            for trace, sensor in zip(task.traces, task.inputs, strict=True)
        ]
        after = yield from ask(dataclasses.replace(asked, bundles=bundle_traces(task.model, traces, task.steps)))
        if after.failed:
            continue
        change = problem.residuals_of(after.observed) - problem.residuals_of(before.observed)
        moves += [_followed(search, np.where(owner == trace, change, 0.0)) for trace in range(len(traces))]
    if not moves:
        raise SimulationError(f"no trace can be simulated with its drive measured once more: {after.failure}")
    return np.array(moves) / np.sqrt(len(moves) / len(task.traces))


def _bands(task: Task, search: LevenbergMarquardt, covariance: Covariance, lacking: Coordinates) -> Steps[Bands]:
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
