"""The slow loop on the bench: the same readings, taken from traces."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from .._printing import Cells, Printed
from ..parts import OPERATING_POINTS
from ..traces import Trace
from ._base import Readings
from ._loops import POSITIONS, HysteresisLoop, find_ends, find_loop
from ._slow_loop import EFFECTS, label, loop_readings

VENTED = 0.01
"""Part of a slow loop from rest, at its start, in which the duty is too low for the converter to evacuate."""
SAME_POINT = 5e3
"""Pa; turbine pressures this close are one operating point, which the bench holds only about."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MeasuredLoops(Printed):
    """Slow loops of one unit by turbine pressure (Pa gauge, rising), and what is read off them, by the names of
    [`SlowLoop`][]'s outputs."""

    turbine_pressures: tuple[float, ...]
    loops: tuple[HysteresisLoop, ...]
    readings: Readings

    @property
    def hysteresis(self) -> dict[float, float]:
        """Mean width over 2 to 8 mm of travel in Pa, by turbine pressure."""
        return {at: loop.mean_width for at, loop in zip(self.turbine_pressures, self.loops, strict=True)}

    def _title(self) -> str:
        return f"{len(self.loops)} slow loop{'' if len(self.loops) == 1 else 's'}"

    def _tables(self) -> list[Cells]:
        rows = [("turbine pressure, mbar", "mean width, mbar")]
        return [[*rows, *((f"{at / 100:.5g}", f"{width / 100:.4g}") for at, width in self.hysteresis.items())]]


def measure_loops(traces: Sequence[Trace], points: Sequence[float] = OPERATING_POINTS) -> MeasuredLoops | None:
    """The slow loops among a unit's traces.

    **Arguments:** `points`: operating points in Pa gauge; a trace whose mean turbine pressure lies within `SAME_POINT`
    of one counts as taken there. Where two traces have the same, the first counts.

    **Returns:** `None` where no trace is a loop with position and pressure.
    """
    pairs = [trace.on_one_clock() for trace in traces if trace.has_pairs]
    runs = [(trace, np.asarray(trace.x_d), np.asarray(trace.p_act)) for trace in pairs]
    # Others may move when a loop still rests, and have no say in where that is.
    runs = [run for run in runs if find_loop(run[0].time, *run[1:]) is not None]
    rests = [_at_rest(trace, x_d) for trace, x_d, _ in runs]
    common = float(np.mean([rest for rest in rests if rest is not None] or [0.0]))
    found: dict[float, tuple[HysteresisLoop, tuple[float, float]]] = {}
    for (trace, x_d, p_act), rest in zip(runs, rests, strict=True):
        # Effects of the gas are as small as the sensors' offsets. Before it moves, the chamber is vented and the rod at
        # the same stop in every trace.
        vented = _at_rest(trace, p_act)
        place = x_d - (0.0 if rest is None else rest - common)
        gauge = p_act - (trace.atmosphere if vented is None else vented)
        loop = find_loop(trace.time, place, gauge)
        if loop is not None:
            found.setdefault(_operating_point(trace, points), (loop, find_ends(place, gauge)))
    if not found:
        return None
    pressures = sorted(found)
    read = tuple(found[at][0] for at in pressures)
    start, end = np.transpose([found[at][1] for at in pressures])
    closing, opening = np.stack([loop.closing for loop in read]), np.stack([loop.opening for loop in read])
    assert read[0].position.shape == POSITIONS.shape, "loops are read at the positions of every reading"
    readings = loop_readings([label(at) for at in pressures], closing, opening, start, end)
    if pressures[0] != min(points, default=pressures[0]):  # effects count from the lowest operating point
        readings = {name: value for name, value in readings.items() if not name.startswith(EFFECTS)}
    return MeasuredLoops(tuple(pressures), read, readings)


def _at_rest(trace: Trace, signal: np.ndarray) -> float | None:
    """Mean of a signal before the converter evacuates, `None` where a trace does not begin at rest."""
    if not trace.start().at_rest:
        return None
    return float(np.mean(signal[trace.time <= trace.time[0] + VENTED * np.ptp(trace.time)]))


def _operating_point(trace: Trace, points: Sequence[float]) -> float:
    mean = 0.0 if trace.p_trb is None else float(np.mean(trace.p_trb))
    near = min(points, key=lambda point: abs(point - mean), default=mean)
    return near if abs(near - mean) <= SAME_POINT else 1e3 * round(mean / 1e3)
