"""The plunger's springs and damping from the response of the pressure, and all that goes with them [2.10-2.12]."""

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ..._errors import InputError, SimulationError
from ...estimation import (
    CHANNELS,
    Calibration,
    Calibrator,
    Evaluation,
    Progress,
    Task,
    asked_first,
    clustered_errors,
    determined_within,
    foreseen,
    plan_task,
    start_calibration,
)
from ...parameters import build_transform, parameter_table, table_row
from ...plants import Actuator, PneumaticActuator
from ...traces import Trace, noise_level
from .. import _limits as limits
from .._filters import duty_steps, sensor_offset, smooth
from .._result import Curve, Identified, NotPossible, bench_test, thinned
from ._chamber_flow import NEEDS, diaphragm_motion, usable, without_position
from ._flow_areas import gather_entries

BOLD, CAREFUL = 1e4, 1.0
"""First step sizes (inverse dampings): the regressions before this leave little to do, but for weakly determined
directions, which a damped fit would creep along; where they don't, a bold fit can get stuck."""
DYNAMICS = ("converter.membrane_stiffness", "converter.return_spring_stiffness", "converter.plunger_damping")
"""What only a step of the duty distinguishes from the slopes of the orifices."""
ROUNDS = 3
"""Fits, each without what the one before could not determine."""


@bench_test(
    "plunger", "2.7, 2.10-2.12", "Nonlinear least squares of the pressure for converter and chamber, position as input."
)
def identify_plunger(model: Actuator, traces: Sequence[Trace]) -> Identified:
    """Stiffnesses and damping of the plunger, refined together with magnetic force, orifices and volume [2.10-2.12].

    **Arguments:** `model`: with what [`identify_magnetic_force`][] and [`identify_flow_areas`][] found; `traces`: with
    `pwm` in %, `p_act` in Pa, and best `x_d` in m.

    **Returns:** those that the traces determine, in the units of the table; the others stay what the model has.
    """
    used = usable(traces)
    if not used:
        raise NotPossible(NEEDS)
    half, names = _pneumatic_half(model)
    stepped = any(len(duty_steps(trace)) for trace in used)
    try:
        driven = [drive_by_position(model, trace) for trace in used]
        calibration, calibrator = _fit(half, names, driven, () if stepped else DYNAMICS)
    except SimulationError as error:
        raise NotPossible(f"the pressure could not be simulated: {error}") from error
    lost = _ran_away(calibrator)
    if lost:
        sentence = (
            f"{', '.join(lost)} left what is plausible, by a factor of {limits.FACTOR_PLUNGER:g}, so nothing is changed"
        )
        raise NotPossible(sentence, *_trouble(calibration))
    values, errors, limitations = gather_entries(half, calibration.model, names, _errors(calibration, calibrator))
    force = errors.get("converter.magnetic_force")
    if force is not None and np.any(np.isnan(force)):
        # Powers of the duty stand in for each other: with one held, the error of the next means nothing by itself.
        errors["converter.magnetic_force"] = np.full_like(force, np.nan)
    return Identified(
        method=f"{calibration.count} samples of the pressure of {len(used)} traces; converter and chamber by nonlinear "
        f"least squares with the position as input, in {calibration.progress.iteration} steps",
        values=values,
        std_errors=errors,
        limitations=(*_trouble(calibration), *limitations, *_unknown_offsets(model, used), *without_position(traces)),
        figures=tuple(
            _figure(result.trace, result.simulated["p_act"], result.offset["p_act"]) for result in calibration.traces
        ),
        samples=calibration.count,
    )


def foreseen_plunger(model: Actuator, traces: Sequence[Trace]) -> Iterator[list[Evaluation]]:
    """What the fit of such traces will ask, to be compiled ahead; nothing where that is not known yet."""
    with contextlib.suppress(InputError, SimulationError):
        half, names = _pneumatic_half(model)
        driven = [trace.replace(x_drive=np.zeros(len(trace.time)), x_d=None) for trace in usable(traces)]
        task = plan_task(half, driven, free=names, channels=("p_act",))
        yield asked_first(task)
        yield from foreseen(task)


def _pneumatic_half(model: Actuator) -> tuple[PneumaticActuator, list[str]]:
    """Converter, line and chamber of a model, and the names of what a fit moves of them."""
    half = PneumaticActuator(model.converter, model.line, model.chamber, model.diaphragm, model.air)
    table = parameter_table(half)
    return half, [name for name, row in table.items() if name.startswith(("converter.", "chamber.")) and not row.held]


def drive_by_position(model: Actuator, trace: Trace) -> Trace:
    """A trace whose measured position, smoothed and without its sensor's offset, drives the pneumatic model."""
    assert trace.p_act is not None
    pressure = smooth(trace.time, trace.p_act, noise_level(trace.p_act, "p_act"))
    return trace.replace(x_drive=diaphragm_motion(model, trace, pressure).value, x_d=None)


def _fit(
    half: PneumaticActuator, names: list[str], traces: list[Trace], held_at_first: Sequence[str]
) -> tuple[Calibration, Calibrator]:
    """The fit without the entries that the traces do not determine; bounds of no width hold them, for which nothing is
    compiled again."""
    task = plan_task(half, traces, free=names, channels=("p_act",))
    start = dict(zip(task.selection.entries, task.selection.values(half).tolist(), strict=True))
    held = set(held_at_first)
    for _ in range(ROUNDS):
        calibrator = _begin(task, start, held, BOLD)
        while more := set(_not_determined(calibrator)) - held:
            held |= more
            calibrator = _begin(task, start, held, BOLD)
        calibrator = _run(calibrator, task, start, held)
        more = set(_ran_away(calibrator)[:1] or _not_determined(calibrator))
        if more <= held:
            break
        held |= more
    return calibrator.finish(), calibrator


def _run(calibrator: Calibrator, task: Task, start: dict[str, float], held: set[str]) -> Calibrator:
    """The finished fit; one that got stuck is tried once more with small steps, and the better one counts."""
    ends = [calibrator]
    while not calibrator.minimiser.progress.finished:
        calibrator.minimiser.step()
    if not calibrator.minimiser.progress.converged:
        ends.append(_begin(task, start, held, CAREFUL))
        while not ends[-1].minimiser.progress.finished:
            ends[-1].minimiser.step()
    return min(ends, key=lambda end: end.minimiser.progress.cost)


def _ran_away(calibrator: Calibrator) -> list[str]:
    """Positive entries that left what is plausible, in the order of the table: the membrane's stiffness first."""
    selection, transform = calibrator.task.selection, calibrator.transform
    before = selection.values(calibrator.task.model)
    after = np.asarray(transform.to_physical(np.asarray(calibrator.minimiser.progress.coordinates)))
    return [
        entry
        for entry, positive, old, new in zip(selection.entries, transform.positive, before, after, strict=True)
        if positive and not 1 / limits.FACTOR_PLUNGER <= new / old <= limits.FACTOR_PLUNGER
    ]


def _begin(task: Task, start: dict[str, float], held: set[str], step_size: float) -> Calibrator:
    """A calibration at its start values, with a first step of given size."""
    task = dataclasses.replace(task, bounds={entry: (start[entry], start[entry]) for entry in held})
    values = np.array(list(start.values()))
    transform = build_transform(parameter_table(task.model), task.selection.entries, values, task.bounds)
    # A logarithm may lie a bit beside the bound that is the same number.
    coordinates = np.asarray(transform.clip(transform.to_coordinates(values)))
    return start_calibration(task, Progress(tuple(coordinates.tolist()), step_size=step_size))


def _not_determined(calibrator: Calibrator) -> list[str]:
    """Entries that the traces do not determine at the current values."""
    entries, transform = calibrator.task.selection.entries, calibrator.transform
    table = parameter_table(calibrator.task.model)
    # A coefficient that starts near zero is no less determined for it: it counts by its printed size.
    usual = np.array([abs(np.ravel(table_row(table, entry).default)[0]) for entry in entries])
    size = np.where(transform.positive, 1.0, np.maximum(usual / transform.scale, 1.0))
    good = determined_within(calibrator.minimiser.linearisation()[1] * size, 1.0, limits.ERROR)
    return [entry for entry, known in zip(entries, good, strict=True) if not known]


def _errors(calibration: Calibration, calibrator: Calibrator) -> dict[str, float]:
    """Standard errors of the entries that were not held."""
    residuals, columns = calibrator.minimiser.linearisation()
    free = np.linalg.norm(columns, axis=0) > 0
    groups = np.arange(len(residuals)) // (int(limits.CORRELATION_PLUNGER) * len(CHANNELS))
    errors = clustered_errors(residuals, columns[:, free], groups)
    slope = np.abs(np.asarray(calibrator.transform.slope(np.asarray(calibration.progress.coordinates)))[free])
    entries = np.array(calibrator.task.selection.entries)[free]
    return dict(zip(entries.tolist(), (errors * slope).tolist(), strict=True))


def _trouble(calibration: Calibration) -> tuple[str, ...]:
    """Sentences about a fit that did not end well."""
    sentences = []
    if not calibration.progress.converged:
        sentences.append(f"the fit did not converge: {calibration.progress.verdict}")
    left = float(np.sqrt(calibration.uncertainty.scale))
    if left > limits.MISFIT:
        sentences.append(
            f"what remains of the pressure is {left:.1f} times the sensor's noise: the model lacks something that the "
            "standard errors don't know of"
        )
    return tuple(sentences)


def _unknown_offsets(model: Actuator, traces: Sequence[Trace]) -> tuple[str, ...]:
    names = [t.name for t in traces if t.x_d is not None and not sensor_offset(model, t, "x_d").known]
    if not names:
        return ()
    return (f"{', '.join(names)} did not begin at rest, so an offset of the position sensor counts as volume",)


def _figure(trace: Trace, simulated: Float[np.ndarray, " time"], offset: float) -> Curve:
    assert trace.p_act is not None
    chosen = thinned(len(trace.time))
    time, title = trace.time[chosen], "Chamber pressure with the measured position as input"
    points, line = (time, (trace.p_act - offset)[chosen] / 100), (time, simulated[chosen] / 100)
    return Curve("time / s", "chamber pressure / mbar absolute", points, line, title, trace.name)
