"""What comes of a calibration that has ended: values, their covariance, and every trace simulated with them."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..parameters import select
from ._bands import Bands, predicted_spread
from ._bundle import CHANNELS
from ._calibration import Calibration, comparing
from ._evaluation import Evaluation, Steps, ask
from ._evidence import turns
from ._least_squares import LeastSquares, least_squares
from ._residuals import Sensors
from ._search import LevenbergMarquardt
from ._task import Task

Covariance = Float[np.ndarray, "entries entries"]


def finishing(task: Task, search: LevenbergMarquardt, sensors: Sensors, notes: tuple[str, ...]) -> Steps[Calibration]:
    """The result, as a computation."""
    problem, progress, transform = search.problem, search.progress, search.problem.transform
    everything, count = search.uncertainty(), len(task.selection.entries)
    coordinates = np.asarray(progress.coordinates)
    values, slope = np.asarray(transform.to_physical(coordinates)), np.asarray(transform.slope(coordinates))
    uncertainty = everything.first(count)
    more = _scatter(uncertainty, np.array(progress.wanted)[:, :count]) if progress.wanted else np.zeros((count, count))
    moved = _moved_by_gains(task, search)
    if task.tolerances:
        moved = np.column_stack([moved, (yield from _moved_by_tolerances(task, search))])
    moved = np.where(uncertainty.determined[:, None], moved[:count], 0.0)
    more = more + moved @ moved.T
    uncertainty = dataclasses.replace(uncertainty, covariance=uncertainty.covariance + more)
    model = task.selection.unpack(task.model, values[:count])
    late = task.late_duty and progress.coordinates[-1] != 0.0
    delay = float(values[-1]) if late else 0.0
    errors = yield from _bands(task, search, uncertainty.covariance)
    compared = yield from comparing(task, model, delay, sensors, errors)
    with np.errstate(over="ignore"):  # the error of a value that ran away may be beyond every number
        covariance = uncertainty.covariance * np.outer(slope[:count], slope[:count])
    return Calibration(
        model,
        task,
        transform,
        progress,
        values[:count],
        covariance,
        uncertainty,
        compared,
        problem.count,
        sensors,
        delay,
        float(slope[-1] * everything.std_errors[-1]) if late else None,
        notes,
    )


def _scatter(uncertainty: LeastSquares, wanted: Float[np.ndarray, "steps entries"]) -> Covariance:
    """Corrections that go to and fro say how well the numbers themselves are known: by the steps since the first turn,
    or by the last one."""
    wanted = np.where(uncertainty.determined, wanted, 0.0)
    first = turns(wanted / np.where(uncertainty.determined, uncertainty.std_errors, 1.0))[:1]
    last = wanted[int(first[0]) :] if len(first) else wanted[-1:]
    return last.T @ last / len(last)


def _moved_by_gains(task: Task, search: LevenbergMarquardt) -> Float[np.ndarray, "coordinates gains"]:
    """By how much every coordinate moves when the gain of a sensor is off by its uncertainty, to first order."""
    point, observed = search.point, search.slopes.evaluated.observed
    moved = [np.zeros((point.columns.shape[1], 0))]
    for channel, part in task.gains.items():
        if channel not in task.channels:
            continue
        only = np.arange(len(CHANNELS)) == CHANNELS.index(channel)
        column = part * search.problem.whitened([(lanes * only)[..., None] for lanes in observed])[:, 0]
        padded = np.append(column, np.zeros(len(point.columns) - len(column)))
        moved.append(-least_squares(point.columns, padded).values[:, None])
    return np.column_stack(moved)


def _moved_by_tolerances(task: Task, search: LevenbergMarquardt) -> Steps[Float[np.ndarray, "coordinates tolerances"]]:
    """By how much every coordinate moves when one that is held moves by its tolerance, to first order."""
    problem, point = search.problem, search.point
    asked = problem.evaluation(np.asarray(search.progress.coordinates))
    held = select(asked.model, list(task.tolerances))
    evaluated = yield from ask(Evaluation(asked.model, problem.bundles, asked.delay, held))
    sizes = np.array([task.tolerances[entry] for entry in held.entries])
    columns = problem.whitened(evaluated.columns)[:, : len(sizes)] * sizes
    padded = np.concatenate([columns, np.zeros((len(point.columns) - len(columns), len(sizes)))])
    return np.stack([-least_squares(point.columns, column).values for column in padded.T], axis=1)


def _bands(task: Task, search: LevenbergMarquardt, covariance: Covariance) -> Steps[Bands]:
    """Standard errors of what is observed of all traces, by the covariance of the coordinates of the entries.

    Derivatives are those that told the covariance, and from where they are: what traces tell of a sum is far more than
    of its parts, and other derivatives, though as good, would not cancel.
    """
    everything, count = np.array(search.uncertainty().covariance), len(covariance)
    everything[:count, :count] = covariance
    scale = np.asarray(search.problem.transform.slope(search.slopes.at))
    with np.errstate(over="ignore", invalid="ignore"):  # of a value that ran away
        units = everything * np.outer(scale, scale)
    asked = search.problem.evaluation(search.slopes.at, slopes=True)
    return (yield from predicted_spread(task, asked, search.slopes.evaluated, units))
