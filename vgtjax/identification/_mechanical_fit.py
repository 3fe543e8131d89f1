"""Output-error fit of the mechanical half: measured drive in, position out, all parameters at once."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from .._errors import SimulationError
from ..estimation import CHANNELS, SEGMENT, Bounds, Calibration, Calibrator, calibrate, plan_task, start_calibration
from ..parameters import Selection, parameter_table, replace_parameters, select
from ..plants import AbstractModel, MechanicalActuator
from ..traces import Trace
from ._axis_regression import regress_axis
from ._motion import BLOCK, Motion, mechanical_half, plain_friction, read_motions
from ._regression import determined, usual_factor
from ._result import Curve, Identified
from ._weak_form import FEWEST_HELD, at_closed_stop

VAGUE = 0.2
"""Relative standard error above which a parameter counts as not seen."""
FARTHEST = 30.0
"""Factor by which a positive parameter may leave its start: where the data say little, it would run to infinity."""
ROUNDS = 4
"""Fits, each without the parameters that the one before could not tell."""
DRIFT = 2.5
"""s; without a spring the position remembers every error of the force: residuals farther apart than this are taken for
independent, instead of `BLOCK`."""
EXPLODED = 1e9
"""Standard deviations by which a change of a parameter by its own size may move a sample; more is no derivative."""
DETAILS = ("static_force", "bristle_stiffness", "bristle_damping", "stribeck_velocity", "stribeck_drop")
"""What friction has besides its steady sliding force."""
STILL = 20.0
"""Standard deviations of its noise over which a position must range, or the rod counts as still."""
EXPERIMENTS = 5
"""Of fresh noise on the drive; with five, a standard error from five traces is good to a seventh."""
PLOTTED = 1500
"""Points a curve."""

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
"""What would show a parameter."""


def mechanical_fit(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """All parameters of diaphragm and friction from the response of `x_d` to the measured drive [2.34, 3.6].

    What follows the single tests: nonlinear least squares of the simulated position, from their values. A measured
    pressure is freed of noise and of its sensor's offset before; standard errors contain what is left of both.
    Parameters that the traces do not tell keep the model's value, and `unseen` names them.

    **Arguments:** `model`: with start values; `traces`: with `x_d` and `p_act` or `f_drive`.
    """
    result = Identified(
        "mechanical half",
        "2.34, 3.6, 3.7",
        "Nonlinear least squares of the position that follows from the measured drive, with exact derivatives.",
    )
    half, motions = mechanical_half(model), read_motions(model, traces)
    if any(motion.trace.f_drive is not None for motion in motions):
        # A driven axis has had no tests of its own parts, and drifts away from a start that is only near.
        told = regress_axis(half, motions, candidates(half))
        half = half if isinstance(told, str) else replace_parameters(half, told)
    response = fit_response(half, motions)
    if isinstance(response, str):
        return dataclasses.replace(result, unseen=(response,))
    return dataclasses.replace(
        result,
        values=response.values,
        std_errors=response.std_errors,
        unseen=response.unseen,
        figures=response_figures(response),
        samples=response.calibration.count,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Response:
    """A fitted mechanical half: `values` and `std_errors` by name, and the names that keep the model's value."""

    calibration: Calibration
    values: dict[str, np.ndarray]
    std_errors: dict[str, np.ndarray]
    untold: tuple[str, ...]

    @property
    def model(self) -> MechanicalActuator:
        """The model with the fitted values."""
        return mechanical_half(self.calibration.model)

    @property
    def unseen(self) -> tuple[str, ...]:
        """A sentence for each parameter that keeps its value."""
        return tuple(untold(name) for name in self.untold)


def untold(name: str) -> str:
    """Why a parameter has no value."""
    return f"{name}: these traces do not tell it; {REMEDIES.get(name, 'record motion that depends on it')}"


def fit_response(
    model: AbstractModel, motions: Sequence[Motion], begin: MechanicalActuator | None = None
) -> Response | str:
    """Fits what motions tell of diaphragm and friction, or says why they tell nothing.

    The search begins at the values of `begin` where it is given. What turns out to be untold returns to the model's
    value, with which the rest will be used, and the rest is fitted again.
    """
    half = mechanical_half(model)
    moving = [motion for motion in motions if np.ptp(motion.position) > STILL * motion.noise]
    if not moving:
        return NOTHING_MOVES
    traces = [motion.trace for motion in moving]
    half, stopped = _with_room(half, moving)
    entries = candidates(half)
    free = np.array([stopped or entry != "diaphragm.travel" for entry in entries])
    selection = select(half, free=entries)
    usual = np.asarray(selection.pack(half))
    first = np.where(free, selection.pack(half if begin is None else begin), usual)
    starts = [first]
    try:
        for _ in range(ROUNDS):
            calibration = _fit_from(starts, half, traces, selection, first, free)
            whole = _linearised(calibration)
            told = _told(whole, calibration, moving, free)
            if np.array_equal(told, free):
                break
            # Values found beside some that are given up need not go with the model's own.
            kept = [calibration.values, first] if _regular(whole) else [first]
            starts, free = [np.where(told, values, usual) for values in kept], told
        return _response(calibration, whole, moving, free) if _regular(whole) else NO_DERIVATIVES
    except SimulationError as error:
        return str(error)


def _fit_from(
    starts: Sequence[np.ndarray],
    half: MechanicalActuator,
    traces: Sequence[Trace],
    selection: Selection,
    first: np.ndarray,
    free: np.ndarray,
) -> Calibration:
    """A fit of what is free from the first of the starts that can be simulated."""
    for start in starts:
        bounds = _bounds(half, selection.entries, first, start, free)
        begin = selection.unpack(half, start)
        try:
            return calibrate(plan_task(begin, traces, free=selection.entries, bounds=bounds, channels=("x_d",)))
        except SimulationError:
            if start is starts[-1]:
                raise
    raise AssertionError("a fit has a start")


def candidates(half: MechanicalActuator) -> list[str]:
    """Entries of diaphragm and friction that a fit may move: not held by default, nor zero or infinite by choice."""
    table = parameter_table(half)
    names = [name for name, row in table.items() if name.startswith(("diaphragm.", "friction.")) and not row.held]
    selection = select(half, free=names)
    values = dict(zip(selection.entries, np.asarray(selection.pack(half)), strict=True))
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


def _with_room(half: MechanicalActuator, motions: Sequence[Motion]) -> tuple[MechanicalActuator, bool]:
    """`half` with a travel that lets the rod go where it went, and whether the rod rests at its closed stop.

    Where it does not, a fit could only push a stop that is too near out of the way, and no farther.
    """
    preload, stiffness = float(half.diaphragm.preload), float(half.diaphragm.stiffness)
    friction = float(plain_friction(half).coulomb_force)
    held = sum(np.count_nonzero(at_closed_stop(motion, preload, stiffness, friction)) for motion in motions)
    if held >= FEWEST_HELD:
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
            ends[entry] = (usual / FARTHEST, usual * FARTHEST)
    return ends


def _linearised(calibration: Calibration) -> Calibrator:
    """The problem at the fitted values with nothing held."""
    task = calibration.task
    return start_calibration(
        plan_task(calibration.model, task.fit, free=task.selection.entries, channels=task.channels)
    )


def _regular(whole: Calibrator) -> bool:
    """Whether the fit ended where derivatives mean something: bristles as short as a sample's path are chaotic."""
    columns = whole.minimiser.linearisation()[1]
    return bool(np.all(np.isfinite(columns))) and float(np.max(np.abs(columns), initial=0.0)) < EXPLODED


def _told(
    whole: Calibrator, calibration: Calibration, motions: Sequence[Motion], free: Bool[np.ndarray, " entries"]
) -> np.ndarray:
    """Which of the free entries the traces determine, and did not drive to the far end of what they may be."""
    table, entries = parameter_table(calibration.model), calibration.task.selection.entries
    if not _regular(whole):
        return free & ~np.array([entry.rpartition(".")[2] in DETAILS for entry in entries])
    usual = np.array([abs(np.asarray(table[entry].default)) for entry in entries])
    size = whole.transform.scale
    relative = np.where(whole.transform.positive, 1.0, np.maximum(size, usual) / size)
    columns = whole.minimiser.linearisation()[1]
    errors = np.sqrt(np.diag(_covariance(whole, motions, ~free)))
    seen = determined(columns * relative, usual_factor(columns[:, free], errors[free]), VAGUE)
    return free & seen & ~(calibration.at_bound & calibration.transform.positive)


def _response(calibration: Calibration, whole: Calibrator, motions: Sequence[Motion], free: np.ndarray) -> Response:
    entries = calibration.task.selection.entries
    errors = np.sqrt(np.diag(_covariance(whole, motions, ~free)) + _drive_variances(whole, motions, ~free))
    slope = np.where(whole.transform.positive, calibration.values, whole.transform.scale)
    told = np.flatnonzero(free)
    return Response(
        calibration,
        {entries[i]: np.asarray(calibration.values[i]) for i in told},
        {entries[i]: np.asarray(errors[i] * slope[i]) for i in told},
        tuple(np.array(entries)[~free]),
    )


def _covariance(
    whole: Calibrator, motions: Sequence[Motion], held: Bool[np.ndarray, " entries"]
) -> Float[np.ndarray, "entries entries"]:
    """Covariance of the coordinates, with all that makes fitted values wrong.

    Scores are summed over stretches of `BLOCK` or `DRIFT` seconds, because what is left of the pressure's noise, and
    what the model lacks, lasts longer than a sample. The unknown offset of a pressure acts like a preload of that trace
    alone. Held parameters may be wrong by `VAGUE`.
    """
    residuals, columns = whole.minimiser.linearisation()
    seconds = BLOCK if float(mechanical_half(whole.task.model).diaphragm.stiffness) > 0 else DRIFT
    owner, block = _layout(whole, motions, seconds)
    bread = _bread(columns, held)
    scores = np.zeros((block.max() + 1, columns.shape[1]))
    np.add.at(scores, block, columns * residuals[:, None])
    white = columns.T @ columns * max(residuals @ residuals / whole.minimiser.problem.count, 1.0)
    clustered = scores.T @ scores * (len(scores) / max(len(scores) - columns.shape[1], 1))
    shifts = np.diag(np.where(held, 1 / VAGUE**2, 0.0))
    if "diaphragm.preload" in (entries := list(whole.task.selection.entries)):
        at = entries.index("diaphragm.preload")
        per_newton = columns[:, at] / whole.transform.scale[at]
        for number, motion in enumerate(motions):
            shift = columns.T @ (per_newton * (owner == number)) * motion.force_error
            shifts = shifts + np.outer(shift, shift)
    worst = [bread @ (noise + shifts) @ bread for noise in (white, clustered)]
    larger = np.maximum(np.diag(worst[0]), np.diag(worst[1]))
    grow = np.sqrt(larger / np.maximum(np.diag(worst[0]), 1e-300))
    return worst[0] * np.outer(grow, grow)


def _drive_variances(
    whole: Calibrator, motions: Sequence[Motion], held: Bool[np.ndarray, " entries"]
) -> Float[np.ndarray, " entries"]:
    """Variances of the coordinates from noise of the drive that its smoothing lets through.

    By experiment: fresh noise on the smoothed drive, smoothed again, moves the simulated position, and that moves the
    fit by a linear step.
    """
    noisy = [number for number, motion in enumerate(motions) if motion.drive_noise > 0]
    residuals, columns = whole.minimiser.linearisation()
    bread, owner = _bread(columns, held), _layout(whole, motions, BLOCK)[0]
    variances, random = np.zeros(columns.shape[1]), np.random.default_rng(0)
    for _ in range(EXPERIMENTS if noisy else 0):
        traces = [motion.with_fresh_noise(random).trace for motion in motions]
        task = dataclasses.replace(whole.task, fit=traces)
        change = start_calibration(task).minimiser.linearisation()[0] - residuals
        moves = [bread @ (columns.T @ (change * (owner == number))) for number in noisy]
        variances += np.sum(np.square(moves), axis=0) / EXPERIMENTS
    return variances


def _bread(columns: np.ndarray, held: Bool[np.ndarray, " entries"]) -> np.ndarray:
    """Inverse of the normal equations, in which held entries may be wrong by `VAGUE`."""
    normal = columns.T @ columns + np.diag(np.where(held, 1 / VAGUE**2, 0.0))
    lengths = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    return np.linalg.pinv(normal / np.outer(lengths, lengths), rcond=1e-14, hermitian=True) / np.outer(lengths, lengths)


def _layout(whole: Calibrator, motions: Sequence[Motion], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """The trace, and the stretch of so many seconds, of every residual."""
    owners, blocks, first = [], [], 0
    problem, channels = whole.minimiser.problem, len(CHANNELS)
    for bundle in problem.bundles:
        trace = np.asarray(bundle.indices)[bundle.lane_trace]
        interval = np.array([motion.interval for motion in motions])[trace]
        lanes = np.maximum(np.round(seconds / (SEGMENT * interval)), 1.0)
        key = np.stack([trace, np.floor(bundle.lane_segment / lanes).astype(int)])
        number = np.unique(key, axis=1, return_inverse=True)[1].reshape(-1)
        owners.append(np.repeat(trace, SEGMENT * channels))
        blocks.append(np.repeat(first + number, SEGMENT * channels))
        first += int(number.max()) + 1
    return np.concatenate(owners), np.concatenate(blocks)


def response_figures(response: Response) -> tuple[Curve, ...]:
    """Measured and simulated position over time, one curve a trace."""
    curves = []
    for result in response.calibration.traces:
        chosen = slice(None, None, max(1, len(result.trace.time) // PLOTTED))
        time, measured = result.trace.time[chosen], np.asarray(result.trace.x_d)[chosen]
        simulated = result.simulated["x_d"][chosen] + result.offset["x_d"]
        curves.append(
            Curve(
                "time, s",
                "position, mm",
                (time, 1e3 * measured),
                (time, 1e3 * simulated),
                "measured and simulated position",
                result.trace.name,
            )
        )
    return tuple(curves)
