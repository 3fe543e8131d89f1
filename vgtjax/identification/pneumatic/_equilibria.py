"""Stretches of a trace over which the plunger is in equilibrium, and the mean force on it [2.8]."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...plants import Actuator
from ...traces import noise_level
from .. import _limits as limits
from .._filters import holds, slow_blocks
from ._chamber_flow import ChamberRecord


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


def find_equilibria(model: Actuator, record: ChamberRecord, number: int) -> list[Equilibrium]:
    """Settled ends of holds and blocks of slow ramps over which the plunger is (nearly) closed, on trace `number`."""
    stretches = [
        _settled_end(model, record, hold) for hold in holds(record.trace, limits.HOLD_SETTLING + limits.HOLD_TIME)
    ]
    # A hold is no ramp: what is constant is left to the stretches above.
    stretches += [
        block
        for block in slow_blocks(record.trace, limits.RAMP_TIME, limits.RAMP_RATE, limits.RAMP_ROUGHNESS)
        if _closed(model, record, np.mean(record.area[block]), limits.RAMP_LIFT)
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
    begin = max(int(np.searchsorted(time, time[hold.start] + limits.HOLD_SETTLING)), hold.start)
    width = max(int(np.searchsorted(time[begin : hold.stop], time[begin] + limits.HOLD_TIME)), 1)
    if hold.stop - begin <= width:
        return None
    area, error = record.area[begin : hold.stop], record.area_error[begin : hold.stop]
    # Where the pressure is at atmosphere no area is determined, and the plunger may be open.
    weight = np.where(np.isnan(area), 0.0, 1 / np.square(error))
    window = np.ones(width)
    with np.errstate(invalid="ignore"):
        smoothed = np.convolve(np.nan_to_num(area) * weight, window, "same") / np.convolve(weight, window, "same")
    open_at = np.flatnonzero(~_closed(model, record, smoothed, limits.HOLD_LIFT))
    if len(open_at):
        begin += int(open_at[-1]) + 1
    long_enough = begin < hold.stop and time[hold.stop - 1] - time[begin] >= limits.HOLD_TIME
    return slice(begin, hold.stop) if long_enough else None


def _between(record: ChamberRecord, stretch: slice) -> bool:
    """Whether the chamber is between reservoir and atmosphere, where alone the plunger closes [2.8]."""
    pressure = np.mean(record.pressure.value[stretch])
    return bool(
        np.max(record.reservoir[stretch]) + limits.CLOSED_MARGIN < pressure < record.ambient - limits.CLOSED_MARGIN
    )


def _mean(model: Actuator, record: ChamberRecord, stretch: slice, number: int) -> Equilibrium:
    converter, trace = model.converter, record.trace
    assert trace.pwm is not None
    assert trace.p_act is not None
    pressure, noise = trace.p_act[stretch] - record.offset.value, noise_level(trace.p_act, "p_act")
    force = converter.static_force(0.0, record.ambient, np.mean(record.reservoir[stretch]), np.mean(pressure))
    by_noise = converter.actuator_area * noise / np.sqrt(len(pressure))
    area, area_error = _mean_area(record, stretch, noise)
    if trace.pwm[stretch][0] == trace.pwm[stretch][-1]:
        area *= 1 - _lag(model, record, stretch)
    return Equilibrium(
        trace=number,
        force=float(force),
        powers=np.mean(trace.pwm[stretch, None] ** np.arange(5), axis=0),
        area=min(area, 0.0),
        error=float(np.hypot(by_noise, converter.membrane_stiffness * limits.SEATING)),
        area_error=area_error,
    )


def _lag(model: Actuator, record: ChamberRecord, stretch: slice) -> float:
    """Part of the springs' force that damping takes off while the plunger closes at the end of a hold."""
    converter = model.converter
    opening = converter.reservoir_orifice_slope * converter.actuator_area / converter.membrane_stiffness
    settling = np.median(record.per_area[stretch]) * float(opening)
    return float(converter.plunger_damping / converter.membrane_stiffness) * settling


def _mean_area(record: ChamberRecord, stretch: slice, noise: float) -> tuple[float, float]:
    """Mean effective area in m2 over a stretch, and its standard deviation.

    A straight line through the whole stretch gives a mean rate better than the mean of smoothed rates does.
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
