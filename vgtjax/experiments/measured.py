"""The slow loop on the bench: the same readings, taken from traces."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..loops import POSITIONS, Loop, find_ends, find_loop
from ..trace import Trace
from .base import Readings
from .slow_loop import label, loop_readings

SAME_POINT = 5e3
"""Pa; turbine pressures this close are one operating point, which the bench holds only about."""


@dataclasses.dataclass(frozen=True, eq=False)
class MeasuredLoops:
    """Slow loops of one unit by turbine pressure (Pa gauge, rising), and what is read off them, by the names of
    [`SlowLoop`][]'s outputs."""

    turbine_pressures: tuple[float, ...]
    loops: tuple[Loop, ...]
    readings: Readings

    @property
    def hysteresis(self) -> dict[float, float]:
        """Mean width over 2 to 8 mm of travel in Pa, by turbine pressure."""
        return {at: loop.mean_width for at, loop in zip(self.turbine_pressures, self.loops, strict=True)}


def measure_loops(traces: Sequence[Trace], points: Sequence[float] = (0.0, 1.5e5, 3.0e5)) -> MeasuredLoops | None:
    """The slow loops among a unit's traces.

    **Arguments:** `points`: operating points in Pa gauge; a trace whose mean turbine pressure lies within `SAME_POINT`
    of one counts as taken there. Where two traces have the same, the first counts.

    **Returns:** `None` where no trace is a loop with position and pressure.
    """
    found: dict[float, tuple[Loop, tuple[float, float]]] = {}
    for trace in traces:
        if trace.x_d is None or trace.p_act is None:
            continue
        gauge = trace.p_act - trace.atmosphere - _zero(trace)
        loop = find_loop(trace.time, trace.x_d, gauge)
        if loop is not None:
            found.setdefault(_operating_point(trace, points), (loop, find_ends(trace.x_d, gauge)))
    if not found:
        return None
    pressures = sorted(found)
    loops = tuple(found[at][0] for at in pressures)
    start, end = np.transpose([found[at][1] for at in pressures])
    closing, opening = np.stack([loop.closing for loop in loops]), np.stack([loop.opening for loop in loops])
    assert loops[0].position.shape == POSITIONS.shape, "loops are read at the positions of every reading"
    readings = loop_readings([label(at) for at in pressures], closing, opening, start, end)
    return MeasuredLoops(tuple(pressures), loops, readings)


def _zero(trace: Trace) -> float:
    """What the pressure sensor shows of a vented chamber, gauge; effects of the gas are as small as such offsets."""
    return float(trace.start().pressure) - trace.atmosphere if trace.start().at_rest else 0.0


def _operating_point(trace: Trace, points: Sequence[float]) -> float:
    mean = 0.0 if trace.p_trb is None else float(np.mean(trace.p_trb))
    near = min(points, key=lambda point: abs(point - mean), default=mean)
    return near if abs(near - mean) <= SAME_POINT else 1e3 * round(mean / 1e3)
