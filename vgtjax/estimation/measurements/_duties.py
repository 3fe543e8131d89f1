"""The duty of a trace as a fit reads it: held or linear between samples, and with edges between these."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ...traces import Trace
from ._holds import ramped, sample_interval

Late = tuple[tuple[float, ...], ...]
"""By how many samples of its record each edge of each trace is late (negative: early)."""


@dataclasses.dataclass(frozen=True)
class Reading:
    """How duties are read: `linear` has the sample intervals in s of traces where they are linear between samples,
    `edges` how late every edge of each trace is, where their times are known, and `delay` in s that of all beside."""

    linear: tuple[float, ...] = ()
    edges: Late = ()
    delay: float = 0.0


RECORDED = Reading()
"""As duties are recorded."""


@dataclasses.dataclass(frozen=True)
class FoundDuty:
    """What a fit found of the duty of one trace: `delay` in s, whether it was `linear` between samples, and by how many
    seconds each of its `edges` was late beside that; no edges where their times were not found."""

    delay: float
    linear: bool
    edges: tuple[float, ...] = ()

    def applied(self, trace: Trace) -> Trace:
        """The trace with the duty that reached the valve; one without a duty as it is."""
        if "pwm" not in trace.channels:
            return trace
        if len(self.edges) == len(trace.edges()) > 0:
            trace = trace.with_late_edges(self.edges, self.delay)
        trace = trace.with_ramped_duty() if self.linear else trace
        beyond = self.delay - trace.duty_late
        return trace.with_late_duty(beyond) if beyond else trace


def read_duties(traces: Sequence[Trace], linear: Sequence[float], late: Late, delay: float = 0.0) -> list[Trace]:
    """Traces with the duty as it is read: with edges at the times at which they were, where these are known, and else
    ramped where it was linear between samples; `delay` in s of the duty where edges were found."""
    return [
        trace.with_late_edges(in_seconds(trace, each), delay) if each else ramp
        for trace, ramp, each in zip(traces, ramped(traces, linear), late or [()] * len(traces), strict=True)
    ]


def in_seconds(trace: Trace, late: Sequence[float]) -> list[float]:
    """By how much the edges of a trace are late in s."""
    return (sample_interval(trace) * np.asarray(late)).tolist()


def as_recorded(traces: Sequence[Trace]) -> Late:
    """Every edge where its record has it."""
    return tuple((0.0,) * len(trace.edges()) for trace in traces)
