"""Hysteresis loops of position over chamber pressure, and how wide they are (sections 3.2.1 and 4.2)."""

import dataclasses

import numpy as np
from jaxtyping import Float

SPAN = (2e-3, 8e-3)
"""m; where widths are read, clear of both stops."""
SPACING = 0.25e-3
"""m between the positions at which a loop is read."""
POSITIONS = np.linspace(*SPAN, round((SPAN[1] - SPAN[0]) / SPACING) + 1)
"""m; those positions."""
LIFT = 0.2e-3
"""m from rest, and from the end of the way: there the vanes count as begun and ended to move, clear of sensor noise and
of the give of both stops."""
PRESSED = 2.0
"""The pressure must fall on by so many times what the last `LIFT` took: then a stop ended the motion, and not the
pressure's lowest value. It is about one where there is no stop, four and more where there is."""
FEW = 5
"""Samples whose mean stands for one place of the rod at rest."""
SPARSE = 5e-3
"""Part of all samples that tell of a knot at least; where a rod jumps over one, the line is held straight instead."""
SLOWEST = 0.5
"""s; a branch that takes less to cross the span is a step, not a loop."""


@dataclasses.dataclass(frozen=True, eq=False)
class HysteresisLoop:
    """One excursion of the rod, read at the same positions while the vanes close and while they open.

    `position` in m, `closing` and `opening` the chamber pressure in Pa absolute, each of shape `(positions,)`.
    """

    position: Float[np.ndarray, " positions"]
    closing: Float[np.ndarray, " positions"]
    opening: Float[np.ndarray, " positions"]

    @property
    def width(self) -> Float[np.ndarray, " positions"]:
        """Difference of chamber pressure between opening and closing at the same position in Pa."""
        return self.opening - self.closing

    @property
    def mean_width(self) -> float:
        """Mean width over the span in Pa: the hysteresis of section 4.2."""
        return float(np.mean(self.width))


def find_loop(
    time: Float[np.ndarray, " time"],
    x_d: Float[np.ndarray, " time"],
    p_act: Float[np.ndarray, " time"],
    span: tuple[float, float] = SPAN,
) -> HysteresisLoop | None:
    """Reads the loop of a slow run out and back.

    **Arguments:** `time` in s, `x_d` in m, `p_act` in Pa, measured or simulated; `span`: the positions in m
    between which it is read.

    **Returns:** `None` where the run failed, or the rod does not cross the span exactly once each way, or does so
    faster than `SLOWEST`.
    """
    position = np.linspace(*span, round((span[1] - span[0]) / SPACING) + 1)
    top = int(np.argmax(x_d))
    branches = []
    for part in (slice(0, top + 1), slice(top, None)):
        moving = _crossing(x_d[part], span)
        if moving is None or np.ptp(time[part][moving]) < SLOWEST:
            return None
        branches.append(_read(x_d[part][moving], p_act[part][moving], position))
    return HysteresisLoop(position, *branches)


def _crossing(x_d: Float[np.ndarray, " time"], span: tuple[float, float]) -> np.ndarray | None:
    """Which samples of one branch lie within the span and its margins, if it crosses that once."""
    begin, end = span[0] - SPACING, span[1] + SPACING
    if not np.all(np.isfinite(x_d)) or x_d.min() > begin or x_d.max() < end:
        return None
    inside = np.flatnonzero((x_d > begin) & (x_d < end))
    if len(inside) < 2 * (end - begin) / SPACING:
        return None
    # Sensor noise re-enters the ends by a few samples; a second visit would be farther away than the crossing is long.
    if inside[-1] - inside[0] > 1.5 * len(inside):
        return None
    if x_d[inside].min() > span[0] or x_d[inside].max() < span[1]:  # it jumped over an end
        inside = np.arange(max(inside[0] - 1, 0), min(inside[-1] + 2, len(x_d)))
    return inside


def _read(x_d: np.ndarray, p_act: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Pressure at given positions: a least-squares broken line over position, so that noise averages out; as
    straight as may be where the rod jumped and no sample tells.

    The equations are written out: SciPy's splines take 0.2 s to import.
    """
    knots = np.unique([min(x_d.min(), position[0]), *position[::2], max(x_d.max(), position[-1])])
    left, steps = np.clip(np.searchsorted(knots, x_d, side="right") - 1, 0, len(knots) - 2), np.diff(knots)
    share = (x_d - knots[left]) / steps[left]  # of the knot to the right in the value there
    hats = np.zeros((len(x_d), len(knots)))
    hats[np.arange(len(x_d)), left], hats[np.arange(len(x_d)), left + 1] = 1 - share, share
    gram = hats.T @ hats
    told = np.diag(gram)
    least = np.minimum(np.minimum(told[:-2], told[1:-1]), told[2:])
    turns = SPACING * np.diff(np.diff(np.eye(len(knots)), axis=0) / steps[:, None], axis=0)
    held = np.maximum(SPARSE * len(x_d) - least, 0.0)[:, None] * turns
    return np.interp(position, knots, np.linalg.solve(gram + turns.T @ held, hats.T @ p_act))


def find_ends(x_d: Float[np.ndarray, " time"], p_act: Float[np.ndarray, " time"]) -> tuple[float, float]:
    """Pressures at which the vanes begin and end to close, in the unit of `p_act`.

    Where the position has left its rest by `LIFT`, and where it is that far from its top, on the way out: a straight
    line through the samples around each place, so that noise averages out. Counted from the run's own rest and top, so
    the sensor's offset has no say. NaN where the rod does not pass them, or no stop ends its way.
    """
    calm = np.convolve(x_d, np.full(FEW, 1 / FEW), mode="valid")
    top = int(np.argmax(calm)) + FEW // 2
    way_x, way_p = x_d[: top + 1], p_act[: top + 1]
    start, before, end = (
        _pressure_at(way_x, way_p, level) for level in (calm[0] + LIFT, calm.max() - 2 * LIFT, calm.max() - LIFT)
    )
    stopped = p_act.min() < end - PRESSED * (before - end)
    return start, end if stopped else float("nan")


def _pressure_at(x: np.ndarray, p: np.ndarray, level: float) -> float:
    # Half a lift: nearer to the rest, noise would bring in samples that did not move yet, with other pressures.
    near = np.abs(x - level) < 0.5 * LIFT
    if np.count_nonzero(near) < 2:
        return float("nan")
    return float(np.polynomial.Polynomial.fit(x[near] - level, p[near], 1)(0.0))
