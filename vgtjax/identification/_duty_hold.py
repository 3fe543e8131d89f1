"""Whether the duty was held between its samples or went linearly, and how late it is, from fitted delays.

The mean of a duty that goes linearly over an interval `T` is that of a held one `T / 2` earlier, so one fit has both:
held and late by `d` is linear and late by `d + T / 2`. But a duty can't arrive before it is given, and where traces
have several intervals, only one of both makes them all equally late.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ..estimation import Linearised, clustered_errors, least_squares

EVIDENT = 3.0
"""Standard errors by which a delay must differ from zero, or from another, to be different."""
SHARP = 10.0
"""Standard errors that half an interval must have for a delay of none to tell a held duty from a linear one."""


@dataclasses.dataclass(frozen=True)
class HoldVerdict:
    """`hold` is `zero-order` or `linear`, `delay` in s; `reason` says what decided, or why nothing did."""

    hold: str
    delay: float
    decided: bool
    reason: str


def measure_delays(fit: Linearised) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Delays of the duty in s of the traces of each interval, their covariance, and the intervals in s.

    Of a fit with one delay for all: to first order what each group of traces would have by itself. The covariance is
    NaN where the traces do not tell.
    """
    traces, weighed = fit.calibration.task.fit, fit.weighed(fit.calibration.sensors)
    intervals = np.round([float(np.median(np.diff(trace.channels["pwm"].time))) for trace in traces], 6)
    groups, member = np.unique(intervals, return_inverse=True)
    late = weighed.columns[:, -1:] * (member[weighed.trace][:, None] == np.arange(len(groups)))
    columns = np.concatenate([weighed.columns[:, :-1], late], axis=1)
    found = least_squares(columns, -weighed.residuals)
    errors = clustered_errors(weighed.residuals + columns @ found.values, columns, weighed.block)
    larger = np.maximum(errors / np.where(found.determined, found.std_errors, 1.0), 1.0)[-len(groups) :]
    slope = float(fit.problem.transform.scale[-1])
    at = float(fit.at[-1])
    delays = slope * (at + found.values[-len(groups) :])
    covariance = slope**2 * found.covariance[-len(groups) :, -len(groups) :] * np.outer(larger, larger)
    return delays, covariance, groups


def judge_hold(
    delays: Float[np.ndarray, " groups"],
    covariance: Float[np.ndarray, "groups groups"],
    intervals: Float[np.ndarray, " groups"],
    stated: str,
) -> HoldVerdict:
    """The hold and the delay that explain fitted delays.

    **Arguments:** `delays` in s of traces with these sample `intervals` in s, by a fit that took the duty for `stated`.
    """
    if not np.all(np.isfinite(covariance)):
        return HoldVerdict(stated, 0.0, False, "the traces do not tell how late the duty is")
    held = delays - (0.5 * intervals if stated == "linear" else 0.0)
    told = {"zero-order": _common(held, covariance), "linear": _common(held + 0.5 * intervals, covariance)}
    possible = {
        hold: each for hold, each in told.items() if each.misfit < EVIDENT**2 + len(delays) - 1 and not each.early
    }
    chosen = stated if stated in possible else next(iter(possible), stated)
    delay, error = told[chosen].delay, told[chosen].error
    if len(possible) == 1:
        other = next(hold for hold in told if hold not in possible)
        why = "would arrive before it is given" if told[other].early else "would not be equally late in all traces"
        return HoldVerdict(chosen, _none(delay, error), True, f"a duty that is {_WORDS[other]} {why}")
    if not possible:
        return HoldVerdict(
            stated, delay, False, "neither a held duty nor a linear one explains the delays of all traces"
        )
    simple = told["zero-order"]
    if abs(simple.delay) <= EVIDENT * simple.error:
        sharp = SHARP * simple.error < 0.5 * float(np.min(intervals))
        reason = "held and not late is the simplest explanation" if sharp else "the delay is known too badly"
        return HoldVerdict("zero-order", 0.0, bool(sharp), reason)
    return HoldVerdict(
        chosen, delay, False, "a held duty and a linear one that is later by half an interval are the same"
    )


_WORDS: Mapping[str, str] = {"zero-order": "held", "linear": "linear between samples"}


@dataclasses.dataclass(frozen=True)
class _Common:
    """One delay for several, its standard error, how badly it fits them, and whether it is evidently negative."""

    delay: float
    error: float
    misfit: float

    @property
    def early(self) -> bool:
        return self.delay < -EVIDENT * self.error


def _common(delays: np.ndarray, covariance: np.ndarray) -> _Common:
    weights = np.linalg.pinv(covariance)
    information = max(float(np.sum(weights)), 1e-300)
    delay = float(np.sum(weights @ delays)) / information
    left = delays - delay
    return _Common(delay, information**-0.5, float(left @ weights @ left))


def _none(delay: float, error: float) -> float:
    """A delay that may as well be none is none."""
    return delay if abs(delay) > EVIDENT * error else 0.0
