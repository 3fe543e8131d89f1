"""What a fit found out besides the parameters, and how it meets its traces, in sentences."""

import collections
from collections.abc import Iterator

import numpy as np

from ..parameters import parameter_table, table_row
from ._calibration import Calibration
from .search import REACHED

EARLY = 3.0
"""Standard errors from which a duty that comes before its record says so is a fault: as evident as a late one."""
COLOURED = 1.5
"""Errors by windows over those by the noise as it was found, from which that deserves a word."""
MEETS = 1.1
"""RMSE per noise up to which a trace counts as met: five deviations of what 1300 samples of white noise give."""


def found_besides(calibration: Calibration) -> list[str]:
    """A sentence on each thing that a fit found out besides the parameters."""
    return [
        *_search_found(calibration),
        *_duty_found(calibration),
        *_edges_found(calibration),
        *_inputs_found(calibration),
        *_instruments_found(calibration),
        *_starts_found(calibration),
        *_noise_found(calibration),
        *_corrections_found(calibration),
    ]


def traces_met(calibration: Calibration) -> str:
    """A sentence on how the fitted trace that is met worst is met."""
    if any(result.failed for result in calibration.traces if result.use == "fit"):
        return "what remains of some traces is no number, as their simulation failed"
    (trace, channel), worst = max(calibration.noise_ratios.items(), key=lambda pair: pair[1])
    if worst <= MEETS:
        return f"every trace is met to within {worst:.2f} of its sensors' noise"
    return (
        f"{channel} of {trace} is off by {worst:.1f} times its sensor's noise: the model lacks something that errors "
        "don't know of"
    )


def _search_found(calibration: Calibration) -> Iterator[str]:
    if calibration.progress.waterfall:
        yield starts_sentence(calibration)
    if calibration.progress.finer:
        yield "derivatives failed with longer steps along slow traces; the search went on with shorter ones"


def starts_sentence(calibration: Calibration) -> str:
    """How many of the starts have found the best end; those within one of chi^2 are the same."""
    ends, count = calibration.progress.ends, calibration.count
    costs = [each.cost for each in ends if each.status in REACHED and each.cost is not None]
    same = sum(2 * count * (cost - min(costs)) < 1 for cost in costs)
    statuses = collections.Counter(each.status.partition(":")[0] for each in ends)
    counts = ", ".join(f"{number} {status}" for status, number in statuses.items())
    failed = [f"; start {n} {each.status}" for n, each in enumerate(ends) if each.status.startswith("failed")]
    return f"{same} of {len(ends)} starts end at the same optimum ({counts}){''.join(failed)}"


def _duty_found(calibration: Calibration) -> Iterator[str]:
    linear = [
        result.trace.name
        for result in calibration.traces
        if calibration.duty_hold(result.trace) == "linear" != result.trace.duty_hold
    ]
    if linear:
        yield (
            f"the duty of {', '.join(linear)} was linear between samples: held, it would have to reach the valve early"
        )
    if calibration.progress.otherwise:
        yield (
            "whether the duty was held or linear between samples these slow traces cannot tell: they were fitted both "
            "ways, and how far values differ is part of their errors; state duty_hold of the traces if it is known"
        )
    if calibration.duty_delay_error is not None:
        yield delay_found(1e3 * calibration.duty_delay, 1e3 * calibration.duty_delay_error)


def delay_found(delay: float, error: float) -> str:
    """A sentence on a delay of the duty and its standard error, both in ms."""
    way = "later" if delay > 0 else "earlier"
    known = f" +- {error:.3f} ms {way}" if np.isfinite(error) else f" ms {way} (not determined by these traces)"
    said = f"the duty reaches the valve {abs(delay):.3f}{known} than the traces say"
    if not delay < -EARLY * error:  # also where the error is none
        return said
    why = "which none does unless its clock is another: if it is not, values may be off by more than their errors"
    return f"{said}, {why}"


def _edges_found(calibration: Calibration) -> list[str]:
    """Where the edges of duties were, if that is not where their records have them."""
    late = [late for result in calibration.traces for late in calibration.late_edges(result.trace)]
    if not late:
        return []
    beside = " beside that delay" if calibration.duty_delay else ""
    return [
        f"the duty of the traces that were fitted jumps between its samples: its {len(late)} edges were between "
        f"{_beside_record(min(late))} and {_beside_record(max(late))} than recorded{beside}; that their times are not "
        "known is part of all errors, and other traces are read without that"
    ]


def _beside_record(late: float) -> str:
    return f"{1e3 * abs(late):.2f} ms {'later' if late > 0 else 'earlier'}"


def _inputs_found(calibration: Calibration) -> list[str]:
    """How a measured pressure was read that drives the rod."""
    sensors = [
        sensor for result in calibration.traces if (sensor := calibration.input_sensor(result.trace)) is not None
    ]
    if not sensors:
        return []
    resting = [sensor for sensor in sensors if sensor.offset_error]
    noise = max(sensor.noise for sensor in sensors)
    farthest = max((sensor.offset for sensor in resting), key=abs, default=0.0)
    offsets = f", and less what it shows at rest in {len(resting)} of {len(sensors)} traces ({farthest:.3g} Pa at most)"
    return [
        f"the pressure that drives the rod is read without the noise of its sensor, {noise:.3g} Pa"
        f"{offsets if resting else ''}; what that leaves open is part of all errors, and simulate reads it as it is "
        "recorded"
    ]


def _starts_found(calibration: Calibration) -> list[str]:
    """How far from the beginnings of their signals traces start whose start states were free."""
    names = [result.trace.name for result in calibration.traces if result.trace.start_number]
    if not names:
        return []
    farthest: dict[str, tuple[float, float]] = {}
    for entry, (value, error) in calibration.instruments.items():
        state = entry.partition("[")[0]
        if np.isfinite(error) and abs(value) >= abs(farthest.get(state, (0.0, 0.0))[0]):
            farthest[state] = value, error
    units = {"initial.x_d": (1e6, "um"), "initial.p_act": (1.0, "Pa"), "initial.T_act": (1.0, "K")}
    found = [
        f"{scale * farthest[state][0]:.3g} +- {scale * farthest[state][1]:.2g} {unit}"
        for state, (scale, unit) in units.items()
        if state in farthest
    ]
    far = f": at most {', '.join(found)} from the signals' beginnings and the air's temperature" if found else ""
    return [f"the start states of {', '.join(names)} were free{far}"]


def _instruments_found(calibration: Calibration) -> Iterator[str]:
    """Gains of sensors and offsets of inputs that were free."""
    for entry, (value, error) in calibration.instruments.items():
        kind, _, channel = entry.partition(".")
        if kind == "initial":
            continue
        unit = "" if kind == "gain" else f" {table_row(parameter_table(calibration.task.model), entry).unit}"
        known = f"{value:.6g} +- {error:.2g}{unit}" if np.isfinite(error) else "not determined by these traces"
        yield f"the {kind} of the sensor of {channel} is {known}"


def _noise_found(calibration: Calibration) -> Iterator[str]:
    for name, text in (("x_d", "position"), ("p_act", "chamber pressure")):
        sensors = [known[name] for known in calibration.sensors if name in known]
        coloured = sum(len(sensor.memory) > 0 for sensor in sensors)
        if coloured:
            yield f"the noise of the {text} is coloured in {coloured} of {len(sensors)} traces"
        far = sum(round(sensor.outliers * len(sensor.trust)) for sensor in sensors)
        if far:
            yield f"{far} samples of the {text} are outliers and count for little"
    if calibration.budget.excess > COLOURED:
        yield (
            f"residuals are correlated beyond what was found of the sensors' noise: by sums over "
            f"{calibration.budget.window:.2g} s errors are {calibration.budget.excess:.2g} times as large in the median"
        )


def _corrections_found(calibration: Calibration) -> Iterator[str]:
    if calibration.progress.corrections:
        largest = float(np.nanmax(np.abs(calibration.shifts), initial=0.0))
        settled = calibration.progress.settled
        state = "settled" if settled else "did not settle, and their scatter is part of the errors"
        yield (
            f"corrections for sensors and numerical errors moved values by at most {largest:.1f} standard errors, and "
            f"{state}"
        )
    elif calibration.task.unknown.anything:
        yield (
            "no corrections were made for sensors and numerical errors, because the search did not converge, values "
            "ran away, or a simulation failed; errors don't count them"
        )
