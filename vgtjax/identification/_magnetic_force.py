"""The static magnetic force from equilibria of the plunger [2.8-2.9]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..parameters import parameter_table
from ..plants import Actuator
from ..traces import SENSOR_PRESSURE_OFFSET, Trace, noise_level
from ._chamber_flow import NEEDS, ChamberRecord, read_chamber, usable, without_position
from ._filters import holds, slow_blocks
from ._result import Curve, Identified

SETTLE = 0.05
"""s after a duty step in which the plunger still moves: several times damping over stiffness."""
SHORTEST_HOLD = 0.1
"""s; what is left of a hold must be this long to count."""
BLOCK = 0.25
"""s of a slow ramp that make one quasi-equilibrium: long enough for the slope of the pressure, short against it."""
FASTEST_RAMP = 20.0
"""%/s; faster, the plunger's lag counts."""
ROUGHNESS = 0.3
"""%; how far the duty of a ramp may stray from a line over one block."""
HOLD_LIFT, RAMP_LIFT = 20e-6, 300e-6
"""m; lifts by the model up to which a hold counts as settled, and a ramp as quasi-static."""
SEATING = 1e-6
"""m; nearer to zero the position of a closed plunger is not known, however little the sensors' noise: on noise-free
traces the force is off by as much."""
MARGIN = 1500.0
"""Pa from reservoir and atmosphere; nearer, the pressure has nowhere to go and the plunger need not be closed."""
WORST = 0.03
"""Of the full pull: the standard error anywhere between 0 and 100 % that a quartic may have. Above it, the model's
own quartic is only scaled and bent."""
SAME_DUTY = 1.0
"""%; holds nearer than this are one duty."""


@dataclasses.dataclass(frozen=True)
class Equilibrium:
    """Mean force on a (nearly) closed plunger over one stretch of a trace.

    `force` (N) by the measured pressures [2.8], `powers` the means of `pwm^0..pwm^4`, `area` the mean effective area
    to the reservoir in m2 (not positive), `error` and `area_error` their standard deviations, `trace` the number of the
    trace.
    """

    trace: int
    force: float
    powers: Float[np.ndarray, " 5"]
    area: float
    error: float
    area_error: float

    @property
    def duty(self) -> float:
        """Mean duty in percent."""
        return float(self.powers[1])


def identify_magnetic_force(model: Actuator, traces: Sequence[Trace]) -> Identified:
    """Magnetic force as a quartic in the duty, from the balance of pressures on a closed plunger [2.8, 2.9].

    Equilibria are the settled ends of holds; on a slow ramp, blocks of a quarter of a second. While the chamber is
    evacuated the plunger hangs below zero by a lift that goes with the effective area of the reservoir's orifice, so
    the stiffness over that orifice's slope is one more unknown of the regression. While it is filled, blocks count
    only where the flow stays below the jump of the atmosphere's orifice, over which the plunger sits at zero.

    The sensor's constant offset of each trace is one more unknown too, held by what its rest at the start tells; the
    pull without duty is held near the model's, for no equilibrium shows it. Where the equilibria don't carry a quartic,
    the model's own is scaled and, if they allow, bent; its coefficients are then given without standard errors.

    **Returns:** `converter.magnetic_force`. A model with a coil gets only the picture.
    """
    records = [read_chamber(model, trace) for trace in usable(traces)]
    points = [point for i, record in enumerate(records) for point in _equilibria(model, record, i)]
    blank = Identified(
        name="magnetic force",
        equations="2.8, 2.9",
        method="no equilibria were found",
        unseen=("no equilibrium with the chamber between reservoir and atmosphere was found: hold the duty until the "
                f"pressure stands still, or ramp it slowly ({NEEDS})",),
    )  # fmt: skip
    if not points:
        return blank
    solution = _solve(model, points, records)
    coefficients, covariance = solution.coefficients, solution.covariance
    found = solution.form == "quartic"
    errors = np.sqrt(np.diag(covariance)) if found else np.full(5, np.nan)
    coil = "converter.magnetic_force" not in parameter_table(model)
    duties = np.array([point.duty for point in points])
    return Identified(
        name="magnetic force",
        equations="2.8, 2.9",
        method=f"{len(points)} equilibria of {len(records)} traces; {_FORMS[solution.form]} by weighted least squares",
        values={} if coil else {"converter.magnetic_force": coefficients},
        std_errors={} if coil else {"converter.magnetic_force": errors},
        unseen=(*_unseen(solution, duties, coil), *_unknown_offsets(records), *without_position(traces)),
        figures=(_figure(solution, duties),),
        samples=len(points),
    )


def _equilibria(model: Actuator, record: ChamberRecord, number: int) -> list[Equilibrium]:
    stretches = [_settled_end(model, record, hold) for hold in holds(record.trace, SETTLE + SHORTEST_HOLD)]
    # A hold is no ramp: what is constant is left to the stretches above.
    stretches += [
        block
        for block in slow_blocks(record.trace, BLOCK, FASTEST_RAMP, ROUGHNESS)
        if _closed(model, record, np.mean(record.area[block]), RAMP_LIFT)
    ]
    return [
        _mean(model, record, stretch, number)
        for stretch in stretches
        if stretch is not None and _between(record, stretch)
    ]


def _closed(model: Actuator, record: ChamberRecord, area: np.ndarray | float, lift: float) -> np.ndarray:
    """Whether effective areas in m2 belong to a plunger that is closed, or open to the reservoir by less than `lift`.

    Half of the jump of the atmosphere's orifice is left as margin, for the model's jump need not be the true one.
    """
    jump = 0.5 * float(model.converter.atmosphere_orifice[0])
    return np.asarray((area < jump) & (area > -float(model.converter.reservoir_orifice_slope) * lift))


def _settled_end(model: Actuator, record: ChamberRecord, hold: slice) -> slice | None:
    """The longest end of a hold in which the plunger is closed but for noise, `None` where it is too short."""
    time = record.trace.time
    begin = max(int(np.searchsorted(time, time[hold.start] + SETTLE)), hold.start)
    width = max(int(np.searchsorted(time[begin : hold.stop], time[begin] + SHORTEST_HOLD)), 1)
    if hold.stop - begin <= width:
        return None
    area, error = record.area[begin : hold.stop], record.area_error[begin : hold.stop]
    # Where the pressure is at atmosphere no area can be told, and the plunger may be open.
    told = np.where(np.isnan(area), 0.0, 1 / np.square(error))
    window = np.ones(width)
    with np.errstate(invalid="ignore"):
        smoothed = np.convolve(np.nan_to_num(area) * told, window, "same") / np.convolve(told, window, "same")
    open_at = np.flatnonzero(~_closed(model, record, smoothed, HOLD_LIFT))
    if len(open_at):
        begin += int(open_at[-1]) + 1
    long_enough = begin < hold.stop and time[hold.stop - 1] - time[begin] >= SHORTEST_HOLD
    return slice(begin, hold.stop) if long_enough else None


def _between(record: ChamberRecord, stretch: slice) -> bool:
    """Whether the chamber is between reservoir and atmosphere, where alone the plunger closes [2.8]."""
    pressure = np.mean(record.pressure.value[stretch])
    return bool(np.max(record.reservoir[stretch]) + MARGIN < pressure < record.ambient - MARGIN)


def _mean(model: Actuator, record: ChamberRecord, stretch: slice, number: int) -> Equilibrium:
    converter, trace = model.converter, record.trace
    assert trace.pwm is not None
    assert trace.p_act is not None
    pressure, noise = trace.p_act[stretch] - record.offset.value, noise_level(trace.p_act, "p_act")
    force = converter.static_force(0.0, record.ambient, np.mean(record.reservoir[stretch]), np.mean(pressure))
    area, area_error = _mean_area(record, stretch, noise)
    if trace.pwm[stretch][0] == trace.pwm[stretch][-1]:
        area *= 1 - _lag(model, record, stretch)
    return Equilibrium(
        trace=number,
        force=float(force),
        powers=np.mean(trace.pwm[stretch, None] ** np.arange(5), axis=0),
        area=min(area, 0.0),
        error=float(
            np.hypot(converter.actuator_area * noise / np.sqrt(len(pressure)), converter.membrane_stiffness * SEATING)
        ),
        area_error=area_error,
    )


def _lag(model: Actuator, record: ChamberRecord, stretch: slice) -> float:
    """Part of the springs' force that damping takes off while the plunger closes at the end of a hold.

    The pressure settles at the rate at which its own lift empties the chamber, and the lift with it.
    """
    converter = model.converter
    opening = converter.reservoir_orifice_slope * converter.actuator_area / converter.membrane_stiffness
    settling = np.median(record.per_area[stretch]) * float(opening)
    return float(converter.plunger_damping / converter.membrane_stiffness) * settling


def _mean_area(record: ChamberRecord, stretch: slice, noise: float) -> tuple[float, float]:
    """Mean effective area in m2 over a stretch, and its standard deviation.

    A straight line through the whole stretch tells a mean rate better than the mean of smoothed rates does.
    """
    trace = record.trace
    assert trace.p_act is not None
    line = _LineThrough(trace.time[stretch])
    excess, error = line.slope(trace.p_act[stretch]) - np.mean(record.pressure.rate[stretch]), line.error * noise
    per_velocity = np.mean(record.per_velocity[stretch])
    if trace.x_d is not None:
        excess -= per_velocity * (line.slope(trace.x_d[stretch]) - np.mean(record.position.rate[stretch]))
        error = np.hypot(error, per_velocity * line.error * noise_level(trace.x_d, "x_d"))
    per_area = np.median(record.per_area[stretch])
    return float(np.mean(record.area[stretch]) + excess / per_area), float(error / per_area)


class _LineThrough:
    """Slopes of least-squares lines over one stretch of time."""

    def __init__(self, time: Float[np.ndarray, " stretch"]):
        centred = time - np.mean(time)
        self._weights = centred / np.sum(centred**2)
        self.error = float(np.linalg.norm(self._weights))
        """Standard deviation of a slope for noise of deviation one."""

    def slope(self, samples: Float[np.ndarray, " stretch"]) -> float:
        return float(self._weights @ samples)


@dataclasses.dataclass(frozen=True, eq=False)
class _Solution:
    """`coefficients` of the quartic and their covariance; `forces` are the measured ones without lift and offset."""

    form: str
    coefficients: Float[np.ndarray, " 5"]
    covariance: Float[np.ndarray, "5 5"]
    forces: Float[np.ndarray, " points"]


_FORMS = {
    "quartic": "a quartic in the duty, the lift and the offsets",
    "scale and bend": "a scale and a square-law correction of the model's quartic, the lift and the offsets",
    "scale": "a scale of the model's quartic, the lift and the offsets",
}


def _solve(model: Actuator, points: list[Equilibrium], records: list[ChamberRecord]) -> _Solution:
    """The richest form that the equilibria carry over the whole range of duties."""
    known = _model_quartic(model)
    full = float(np.sum(known * 100.0 ** np.arange(5)))
    bases = {
        "quartic": np.eye(5),
        "scale and bend": np.stack([known, np.eye(5)[2]], axis=1),
        "scale": known[:, None],
    }
    grid = np.linspace(0, 100, 101)[:, None] ** np.arange(5)
    for form, basis in bases.items():
        solution = _regress(model, points, records, form, basis)
        if form == "scale" or len(_distinct(points)) >= basis.shape[1]:
            band = np.sqrt(np.sum((grid @ solution.covariance) * grid, axis=1))
            if form == "scale" or np.max(band) < WORST * abs(full):
                break
    return solution


def _model_quartic(model: Actuator) -> Float[np.ndarray, " 5"]:
    """The model's static force, or the quartic through a coil's."""
    duty = np.linspace(0, 100, 41)
    pull = np.asarray(model.converter.magnetic_force.steady_pull(duty, np.zeros_like(duty)))
    return np.linalg.lstsq(duty[:, None] ** np.arange(5), pull, rcond=None)[0]


def _distinct(points: list[Equilibrium]) -> list[float]:
    duties = sorted(point.duty for point in points)
    return [duty for i, duty in enumerate(duties) if i == 0 or duty - duties[i - 1] > SAME_DUTY]


def _regress(
    model: Actuator, points: list[Equilibrium], records: list[ChamberRecord], form: str, basis: np.ndarray
) -> _Solution:
    """Weighted least squares for the coefficients in `basis`, the lift's force an area, and the offsets."""
    lift = float(model.converter.membrane_stiffness / model.converter.reservoir_orifice_slope)
    powers, area = np.stack([point.powers for point in points]), np.array([point.area for point in points])
    force = np.array([point.force for point in points])
    noise = np.hypot([point.error for point in points], lift * np.array([point.area_error for point in points]))
    owner = np.array([point.trace for point in points])
    offsets = float(model.converter.actuator_area) * np.eye(len(records))[owner]
    # The model's lift is an observation like others, so that equilibria without flow don't leave it undetermined.
    # So is its pull without duty, which no equilibrium shows.
    count, idle = basis.shape[1], float(_model_quartic(model)[0])
    prior = np.zeros((2 + len(records), count + 1 + len(records)))
    prior[0, count] = 1 / (LIFT_TRUST * lift)
    prior[1, :count] = basis[0] / IDLE_TRUST
    for i, record in enumerate(records):
        trust = record.offset.std_error if record.offset.known else SENSOR_PRESSURE_OFFSET
        prior[2 + i, count + 1 + i] = 1 / trust
    expected = np.array([1 / LIFT_TRUST, idle / IDLE_TRUST, *np.zeros(len(records))])
    columns = np.concatenate([powers @ basis, area[:, None], -offsets], axis=1) / noise[:, None]
    answer, inverse = _robust(columns, force / noise, prior, expected)
    return _Solution(
        form,
        basis @ answer[:count],
        basis @ inverse[:count, :count] @ basis.T,
        force - area * answer[count] + offsets @ answer[count + 1 :],
    )


def _robust(columns: np.ndarray, target: np.ndarray, prior: np.ndarray, expected: np.ndarray) -> tuple[Any, Any]:
    """Solution and covariance of `columns x = target`, with `prior x = expected` beside it, all in units of noise.

    Huber's weights: an equilibrium that had not settled must not bend the curve. Where the scatter is more than the
    noise explains, it counts.
    """
    rows, weights, scale = len(target), np.ones(len(target)), 1.0
    for _ in range(REWEIGHTINGS):
        system = np.concatenate([columns * weights[:, None] / scale, prior])
        size = np.linalg.norm(system, axis=0)
        inverse = np.linalg.pinv(system / size, rcond=1e-12) / size[:, None]
        answer = inverse @ np.concatenate([target * weights / scale, expected])
        left = target - columns @ answer
        freedom = max(rows - np.sum(np.abs(prior).max(axis=0) == 0) - 1, 1)
        scale = max(1.0, np.sqrt(np.sum((weights * left) ** 2) / freedom))
        spread = max(1.0, np.median(np.abs(left)) / 0.6745)
        weights = np.sqrt(np.minimum(1.0, HUBER * spread / np.maximum(np.abs(left), 1e-9)))
    return answer, inverse @ inverse.T


HUBER = 2.0
"""Standard deviations beyond which a residual counts by its size instead of its square."""
REWEIGHTINGS = 10
"""Enough for three digits of the weights."""
LIFT_TRUST = 0.5
"""Relative standard deviation with which the model's stiffness over slope is believed before the traces speak."""
IDLE_TRUST = 0.05
"""N; the same for the pull without duty, a remanence."""


def _unseen(solution: _Solution, duties: Float[np.ndarray, " points"], coil: bool) -> tuple[str, ...]:
    seen = f"{np.min(duties):.0f} to {np.max(duties):.0f} %"
    sentences = [
        f"equilibria were seen at {seen} duty; outside, and below the duty that closes the plunger, the curve is "
        "extrapolated"
    ]
    if solution.form != "quartic":
        sentences.append(
            f"equilibria at {len(np.unique(np.round(duties)))} duties don't carry a quartic, so the model's was only "
            f"adjusted ({solution.form}) and its coefficients have no standard errors: add holds at other duties"
        )
    if coil:
        sentences.append("the model has a coil in place of the quartic: compare the curve, or fit the coil")
    return tuple(sentences)


def _unknown_offsets(records: list[ChamberRecord]) -> tuple[str, ...]:
    names = [record.trace.name for record in records if not record.offset.known]
    if not names:
        return ()
    return (f"{', '.join(names)} did not begin at rest, so the offset of the pressure sensor is only known to 50 mbar",)


def _figure(solution: _Solution, duties: Float[np.ndarray, " points"]) -> Curve:
    grid = np.linspace(0, 100, 201)
    curve = np.polynomial.polynomial.polyval(grid, solution.coefficients)
    return Curve("duty / %", "magnetic force / N", (duties, solution.forces), (grid, curve), "Magnetic force [2.9]")
