"""Output-error fit of the mechanical half: measured drive in, position out, all parameters at once."""

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool

from ..._errors import InputError, SimulationError
from ...estimation import (
    Calibration,
    Calibrator,
    Evaluation,
    asked_first,
    determined_within,
    error_factor,
    foreseen,
    plan_task,
    start_calibration,
)
from ...parameters import Bounds, Selection, parameter_table, replace_parameters, select
from ...plants import AbstractModel, MechanicalActuator
from ...traces import Trace
from .. import _limits as limits
from .._result import Curve, Identified, NotPossible, bench_test, thinned
from ._axis_regression import regress_axis
from ._clean_signals import even
from ._motion import MotionRecord, dry_level, mechanical_half, read_motions, usable
from ._response_errors import ResponseColumns, covariance, drive_variances, linearise
from ._sliding import at_closed_stop

ROUNDS = 4
"""Fits, each without the parameters that the one before could not determine."""
DETAILS = ("static_force", "bristle_stiffness", "bristle_damping", "stribeck_velocity", "stribeck_drop")
"""What friction has besides its steady sliding force."""
NEVER = ("diaphragm.stop_damping",)
"""Impacts are over within a sample: what a fit makes of them follows the kink of the contact, not its damping."""
NO_DERIVATIVES = (
    "the simulated position has no meaningful derivatives near the fitted values, because the rod is too light or its "
    "bristles too stiff for the steps of the simulation; start from a larger diaphragm.mass or a smaller "
    "friction.bristle_damping"
)
NOTHING_MOVES = "no trace shows the rod move under a measured drive; record x_d together with p_act or f_drive"
REMEDIES = {
    "diaphragm.mass": "record duty steps at 1 kHz",
    "diaphragm.stiffness": "let the rod move over much of its travel",
    "diaphragm.travel": "let the rod rest at its closed stop",
    "diaphragm.stop_stiffness": "press the rod into its stops with different forces",
    "friction.static_force": "record slow motion, and break-away from rest",
    "friction.bristle_stiffness": "turn the rod round inside its travel",
    "friction.bristle_damping": "turn the rod round inside its travel by duty steps, at 1 kHz",
    "friction.viscous_damping": "record motion at different speeds",
    "friction.stribeck_velocity": "record motion at different speeds below 5 mm/s",
}
"""What would determine a parameter."""


@bench_test(
    "mechanical half",
    "2.34, 3.6, 3.7",
    "Nonlinear least squares of the position that follows from the measured drive, with exact derivatives.",
)
def mechanical_fit(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """All parameters of diaphragm and friction from the response of `x_d` to the measured drive [2.34, 3.6].

    What follows the single tests: nonlinear least squares of the simulated position, from their values.

    **Arguments:** `model`: with start values; `traces`: with `x_d` in m, and `p_act` in Pa or `f_drive` in N.

    **Returns:** parameters of diaphragm and friction by name, in the units of the table and of shape `()`.
    """
    half, motions = mechanical_half(model), read_motions(model, traces)
    if any(motion.trace.f_drive is not None for motion in motions):
        # A driven axis has had no tests of its own parts, and drifts away from a start that is only near.
        with contextlib.suppress(NotPossible):
            half = replace_parameters(half, regress_axis(half, motions, candidates(half)))
    return fit_response(half, motions).report()


@dataclasses.dataclass(frozen=True, eq=False)
class ResponseFit:
    """A fitted mechanical half.

    `values` and `std_errors` are by name in the units of the table; names in `not_determined` keep the model's value.
    """

    calibration: Calibration
    values: dict[str, np.ndarray]
    std_errors: dict[str, np.ndarray]
    not_determined: tuple[str, ...]

    @property
    def model(self) -> MechanicalActuator:
        """The model with the fitted values."""
        return mechanical_half(self.calibration.model)

    def report(
        self, names: Sequence[str] | None = None, method: str = "", figures: tuple[Curve, ...] | None = None
    ) -> Identified:
        """What a test that reports only `names` (all by default) found; figures are the fitted positions by default."""
        names = self.calibration.task.selection.entries if names is None else names
        return Identified(
            method=method,
            values={name: self.values[name] for name in names if name in self.values},
            std_errors={name: self.std_errors[name] for name in names if name in self.values},
            limitations=tuple(
                f"{name}: not determined by these traces; {REMEDIES.get(name, 'record motion that depends on it')}"
                for name in names
                if name in self.not_determined
            ),
            figures=self.figures() if figures is None else figures,
            samples=self.calibration.count,
        )

    def figures(self) -> tuple[Curve, ...]:
        """Measured and simulated position over time, one curve per trace."""
        curves = []
        for result in self.calibration.traces:
            chosen = thinned(len(result.trace.time))
            time, title = result.trace.time[chosen], "measured and simulated position"
            measured = (time, 1e3 * np.asarray(result.trace.x_d)[chosen])
            simulated = (time, 1e3 * (result.simulated["x_d"][chosen] + result.offset["x_d"]))
            curves.append(Curve("time, s", "position, mm", measured, simulated, title, result.trace.name))
        return tuple(curves)


def fit_response(
    model: AbstractModel, motions: Sequence[MotionRecord], begin: MechanicalActuator | None = None
) -> ResponseFit:
    """Fits what motions determine of diaphragm and friction [2.34, 3.6].

    The search begins at the values of `begin` where it is given. What turns out not to be determined returns to the
    model's value, with which the rest will be used, and the rest is fitted again.

    **Raises:** `NotPossible` where nothing moves, or derivatives explode; `SimulationError` when a start fails.
    """
    half = mechanical_half(model)
    moving = [motion for motion in motions if np.ptp(motion.position) > limits.RANGE * motion.noise]
    if not moving:
        raise NotPossible(NOTHING_MOVES)
    traces = [motion.trace for motion in moving]
    half, stopped = _with_room(half, moving)
    entries = candidates(half)
    free = np.array([stopped or entry != "diaphragm.travel" for entry in entries])
    selection = select(half, free=entries)
    usual = selection.values(half)
    first = np.where(free, selection.pack(half if begin is None else begin), usual)
    starts = [first]
    for _ in range(ROUNDS):
        calibrator = _fit_from(starts, half, traces, selection, first, free)
        whole = linearise(calibrator, moving)
        determined = _determined(whole, calibrator, free)
        if np.array_equal(determined, free):
            break
        # Values found beside some that are given up need not go with the model's own.
        kept = [selection.values(whole.task.model), first] if _regular(whole) else [first]
        starts, free = [np.where(determined, values, usual) for values in kept], determined
    else:  # what was given up last must have no say in the values of the others
        calibrator = _fit_from(starts, half, traces, selection, first, free)
        whole = linearise(calibrator, moving)
    if not _regular(whole):
        raise NotPossible(NO_DERIVATIVES)
    return _response(calibrator.finish(), whole, free)


def foreseen_response(model: AbstractModel, traces: Sequence[Trace]) -> Iterator[list[Evaluation]]:
    """What a fit of the response of such traces will ask, to be compiled ahead; nothing where that is not known yet."""
    with contextlib.suppress(InputError, SimulationError):
        half, driven = mechanical_half(model), [even(trace) for trace in usable(traces)]
        task = plan_task(half, driven, free=candidates(half), channels=("x_d",))
        yield asked_first(task)
        yield from foreseen(task)


def _fit_from(
    starts: Sequence[np.ndarray],
    half: MechanicalActuator,
    traces: Sequence[Trace],
    selection: Selection,
    first: np.ndarray,
    free: np.ndarray,
) -> Calibrator:
    """A fit of what is free, at its end, from the first of the starts that can be simulated."""
    for start in starts:
        bounds = _bounds(half, selection.entries, first, start, free)
        begin = selection.unpack(half, start)
        try:
            task = plan_task(begin, traces, free=selection.entries, bounds=bounds, channels=("x_d",))
            calibrator = start_calibration(task)
        except SimulationError:
            if start is starts[-1]:
                raise
            continue
        while not calibrator.minimiser.progress.finished:
            calibrator.minimiser.step()
        return calibrator
    raise AssertionError("a fit has a start")


def candidates(half: MechanicalActuator) -> list[str]:
    """Entries of diaphragm and friction that a fit may move: not held by default, nor zero or infinite by choice."""
    table = parameter_table(half)
    names = [name for name, row in table.items() if name.startswith(("diaphragm.", "friction.")) and not row.held]
    selection = select(half, free=names)
    values = dict(zip(selection.entries, selection.values(half), strict=True))
    endless = not np.isfinite(values.get("diaphragm.travel", np.inf))
    return [
        entry
        for entry, value in values.items()
        if np.isfinite(value)
        and (value != 0 or not table[entry.partition("[")[0]].positive)
        and not (endless and entry.startswith("diaphragm.stop_"))
        and entry not in NEVER
        and "[" not in entry
    ]


def _with_room(half: MechanicalActuator, motions: Sequence[MotionRecord]) -> tuple[MechanicalActuator, bool]:
    """`half` with a travel that lets the rod go where it went, and whether the rod rests at its closed stop.

    Where it does not, a fit could only push a stop that is too near out of the way, and no farther.
    """
    preload, stiffness = float(half.diaphragm.preload), float(half.diaphragm.stiffness)
    held = sum(np.count_nonzero(at_closed_stop(motion, preload, stiffness, dry_level(half))) for motion in motions)
    if held >= limits.HELD_SAMPLES:
        return half, True
    reached = max(float(np.max(motion.position)) for motion in motions)
    travel = max(float(half.diaphragm.travel), reached)
    return replace_parameters(half, {"diaphragm.travel": travel}), False


def _bounds(
    half: MechanicalActuator, entries: Sequence[str], first: np.ndarray, now: np.ndarray, free: np.ndarray
) -> Bounds:
    """Far ends for what is free and positive; the others are held between equal ends, which compiles nothing anew."""
    table, ends = parameter_table(half), dict[str, tuple[float | None, float | None]]()
    for entry, usual, value, moves in zip(entries, first.tolist(), now.tolist(), free, strict=True):
        if not moves:
            ends[entry] = (value, value)
        elif table[entry.partition("[")[0]].positive:
            ends[entry] = (usual / limits.FACTOR_RESPONSE, usual * limits.FACTOR_RESPONSE)
    return ends


def _regular(whole: ResponseColumns) -> bool:
    """Whether the fit ended where derivatives mean something: bristles as short as a sample's path are chaotic."""
    columns = whole.columns
    return bool(np.all(np.isfinite(columns))) and float(np.max(np.abs(columns), initial=0.0)) < limits.SENSITIVITY


def _determined(whole: ResponseColumns, calibrator: Calibrator, free: Bool[np.ndarray, " entries"]) -> np.ndarray:
    """Which of the free entries the traces determine, and did not drive to the far end of what they may be."""
    table, entries = parameter_table(whole.task.model), whole.task.selection.entries
    if not _regular(whole):
        return free & ~np.array([entry.rpartition(".")[2] in DETAILS for entry in entries])
    usual = np.array([abs(np.asarray(table[entry].default)) for entry in entries])
    size = whole.transform.scale
    relative = np.where(whole.transform.positive, 1.0, np.maximum(size, usual) / size)
    errors = np.sqrt(np.diag(covariance(whole, ~free)))
    factor = error_factor(whole.triangle[:, free], errors[free])
    good = determined_within(whole.triangle * relative, factor, limits.ERROR_RESPONSE)
    at_bound = calibrator.transform.at_bound(np.asarray(calibrator.minimiser.progress.coordinates))
    good &= free & np.isfinite(errors) & ~(np.asarray(at_bound) & calibrator.transform.positive)
    own = np.where(free, errors * relative, 0.0)
    if np.array_equal(good, free) and np.max(own, initial=0.0) > limits.ERROR_RESPONSE:
        # Correlated residuals blur one parameter more than the median of all.
        good[np.argmax(own)] = False
    return good


def _response(calibration: Calibration, whole: ResponseColumns, free: np.ndarray) -> ResponseFit:
    entries = calibration.task.selection.entries
    errors = np.sqrt(np.diag(covariance(whole, ~free)) + drive_variances(whole, ~free))
    slope = np.where(whole.transform.positive, calibration.values, whole.transform.scale)
    found = np.flatnonzero(free)
    return ResponseFit(
        calibration,
        {entries[i]: np.asarray(calibration.values[i]) for i in found},
        {entries[i]: np.asarray(errors[i] * slope[i]) for i in found},
        tuple(np.array(entries)[~free]),
    )
