"""The plunger's springs and damping from the response of the pressure, and all that goes with them [2.10-2.12]."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._errors import SimulationError
from ..estimation import CHANNELS, SEGMENT, Calibration, Calibrator, Progress, Task, plan_task, start_calibration
from ..parameters import build_transform, parameter_table, table_row
from ..plants import Actuator, PneumaticActuator
from ..traces import Trace, noise_level
from ._chamber_flow import NEEDS, diaphragm_motion, usable, without_position
from ._filters import duty_steps, sensor_offset, smooth
from ._flow_areas import gather_entries
from ._regression import clustered_errors, determined, inverse_gram
from ._result import Curve, Identified

BOLD, CAREFUL = 1e4, 1.0
"""First step sizes (inverse dampings): the regressions before this leave little to do, but for weakly determined
directions, which a damped fit would creep along; where they don't, a bold fit can get stuck."""
WORST = 0.3
"""Relative standard error above which a value counts as not seen, and stays what the model has."""
DYNAMICS = ("converter.membrane_stiffness", "converter.return_spring_stiffness", "converter.plunger_damping")
"""What only a step of the duty tells apart from the slopes of the orifices."""
RUNAWAY = 3.0
"""Factor by which a fit may change a value. Only the plunger's mass keeps springs, damping and slopes from growing
together, and a model that lacks something of the actuator tries to do without a mass."""
ROUNDS = 3
"""Fits, each without what the one before could not tell."""
MISFIT = 1.5
"""Times the sensor's noise; where more remains, the model lacks something."""
CLUSTER = 4 * SEGMENT
"""Samples; errors of neighbours are taken for independent beyond this."""
SHOWN = 1000
"""Points in a picture."""


def identify_plunger(model: Actuator, traces: Sequence[Trace]) -> Identified:
    """Stiffnesses and damping of the plunger, refined together with magnetic force, orifices and volume.

    Nobody measures the plunger, so the transfer function [2.10-2.12] can't be fitted by itself. But with its mass
    given, the response of the pressure tells the rest: a model of converter and chamber, whose volume follows the
    measured position, is fitted to the measured pressure by least squares with exact derivatives. All parameters of
    converter and chamber that are not held by default are free, because none of them can be told alone: softer springs
    with less damping and flatter orifices differ only by what the plunger's mass does in its first milliseconds.

    **Returns:** those that the traces tell. What they don't stays what the model has; start from what
    [`identify_magnetic_force`][] and [`identify_flow_areas`][] found.
    """
    used = usable(traces)
    nothing = Identified(name="plunger", equations="2.7, 2.10-2.12", method="no fit was made")
    if not used:
        return dataclasses.replace(nothing, unseen=(NEEDS,))
    half = PneumaticActuator(model.converter, model.line, model.chamber, model.diaphragm, model.air)
    table = parameter_table(half)
    names = [name for name, row in table.items() if name.startswith(("converter.", "chamber.")) and not row.held]
    stepped = any(len(duty_steps(trace)) for trace in used)
    try:
        driven = [drive_by_position(model, trace) for trace in used]
        calibration, calibrator = _fit(half, names, driven, () if stepped else DYNAMICS)
    except SimulationError as error:
        return dataclasses.replace(nothing, unseen=(f"the pressure could not be simulated: {error}",))
    lost = _ran_away(calibrator)
    if lost:
        sentence = f"{', '.join(lost)} left what is plausible, by a factor of {RUNAWAY:g}, so nothing is changed"
        return dataclasses.replace(nothing, unseen=(sentence, *_trouble(calibration)))
    values, errors, unseen = gather_entries(half, calibration.model, names, _errors(calibration, calibrator))
    force = errors.get("converter.magnetic_force")
    if force is not None and np.any(np.isnan(force)):
        # Powers of the duty stand in for each other: with one held, the error of the next means nothing by itself.
        errors["converter.magnetic_force"] = np.full_like(force, np.nan)
    return Identified(
        name="plunger",
        equations="2.7, 2.10-2.12",
        method=f"{calibration.count} samples of the pressure of {len(used)} traces; converter and chamber by nonlinear "
        f"least squares with the position as input, in {calibration.progress.iteration} steps",
        values=values,
        std_errors=errors,
        unseen=(*_trouble(calibration), *unseen, *_unknown_offsets(model, used), *without_position(traces)),
        figures=tuple(
            _figure(result.trace, result.simulated["p_act"], result.offset["p_act"]) for result in calibration.traces
        ),
        samples=calibration.count,
    )


def drive_by_position(model: Actuator, trace: Trace) -> Trace:
    """A trace whose measured position, smoothed and without its sensor's offset, drives the pneumatic model.

    The chamber answers to the noise of its input, and the orifices rectify the answer: with 8 um smoothed over 5 ms
    only, the volume is off by six standard errors.
    """
    assert trace.p_act is not None
    pressure = smooth(trace.time, trace.p_act, noise_level(trace.p_act, "p_act"))
    return trace.replace(x_drive=diaphragm_motion(model, trace, pressure).value, x_d=None)


def _fit(
    half: PneumaticActuator, names: list[str], traces: list[Trace], untold: Sequence[str]
) -> tuple[Calibration, Calibrator]:
    """The fit without the entries that the traces don't tell, which bounds of no width hold.

    Bounds are numbers, and a selection is part of a program: the same compiled fit serves every round.
    """
    task = plan_task(half, traces, free=names, channels=("p_act",))
    start = dict(zip(task.selection.entries, np.asarray(task.selection.pack(half)).tolist(), strict=True))
    held = set(untold)
    for _ in range(ROUNDS):
        calibrator = _begin(task, start, held, BOLD)
        while unseen := set(_unseen(calibrator)) - held:
            held |= unseen
            calibrator = _begin(task, start, held, BOLD)
        calibrator = _run(calibrator, task, start, held)
        more = set(_ran_away(calibrator)[:1] or _unseen(calibrator))
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
    before = np.asarray(selection.pack(calibrator.task.model))
    after = np.asarray(transform.to_physical(np.asarray(calibrator.minimiser.progress.coordinates)))
    return [
        entry
        for entry, positive, old, new in zip(selection.entries, transform.positive, before, after, strict=True)
        if positive and not 1 / RUNAWAY <= new / old <= RUNAWAY
    ]


def _begin(task: Task, start: dict[str, float], held: set[str], step_size: float) -> Calibrator:
    """A calibration at its start values, with a first step of given size."""
    task = dataclasses.replace(task, bounds={entry: (start[entry], start[entry]) for entry in held})
    values = np.array(list(start.values()))
    transform = build_transform(parameter_table(task.model), task.selection.entries, values, task.bounds)
    # A logarithm may lie a bit beside the bound that is the same number.
    coordinates = np.asarray(transform.clip(transform.to_coordinates(values)))
    return start_calibration(task, Progress(tuple(coordinates.tolist()), step_size=step_size))


def _unseen(calibrator: Calibrator) -> list[str]:
    """Entries that the traces don't tell at the current values."""
    entries, transform = calibrator.task.selection.entries, calibrator.transform
    table = parameter_table(calibrator.task.model)
    # A coefficient that starts near zero is no less told for it: it counts by its printed size.
    usual = np.array([abs(np.ravel(table_row(table, entry).default)[0]) for entry in entries])
    size = np.where(transform.positive, 1.0, np.maximum(usual / transform.scale, 1.0))
    told = determined(calibrator.minimiser.linearisation()[1] * size, 1.0, WORST)
    return [entry for entry, seen in zip(entries, told, strict=True) if not seen]


def _errors(calibration: Calibration, calibrator: Calibrator) -> dict[str, float]:
    """Standard errors of the entries that were not held."""
    residuals, columns = calibrator.minimiser.linearisation()
    free = np.linalg.norm(columns, axis=0) > 0
    groups = np.arange(len(residuals)) // (CLUSTER * len(CHANNELS))
    errors = clustered_errors(residuals, columns[:, free], groups)
    # From the coordinates of the fit to units of the table, as the calibration does with its own.
    usual = np.sqrt(np.diag(inverse_gram(columns[:, free])) * calibration.uncertainty.scale)
    told = np.array(calibrator.task.selection.entries)[free]
    return dict(zip(told.tolist(), (errors / usual * calibration.std_errors[free]).tolist(), strict=True))


def _trouble(calibration: Calibration) -> tuple[str, ...]:
    """Sentences about a fit that did not end well."""
    sentences = []
    if not calibration.progress.converged:
        sentences.append(f"the fit did not converge: {calibration.progress.verdict}")
    left = float(np.sqrt(calibration.uncertainty.scale))
    if left > MISFIT:
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
    thinned = slice(None, None, max(len(trace.time) // SHOWN, 1))
    time, measured = trace.time[thinned], (trace.p_act - offset)[thinned]
    return Curve(
        "time / s",
        "chamber pressure / mbar absolute",
        (time, measured / 100),
        (time, simulated[thinned] / 100),
        "Chamber pressure with the measured position as input",
        trace.name,
    )
