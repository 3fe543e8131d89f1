"""How far models are from each other and from a bench trace (section 5.2.3)."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..plants import AbstractModel
from ..simulation import AbstractStepping, Solution, simulate
from ..traces import ASSUMED_RESERVOIR, Trace

COMPARED = ("x_d", "p_act")
RAMP_SECONDS = 20.0
"""s; the slow ramp of duty, up and down."""


@dataclasses.dataclass(frozen=True)
class Deviation:
    """Root mean square and peak of the difference between two runs: m and Pa."""

    position_rmse: float
    position_peak: float
    pressure_rmse: float
    pressure_peak: float

    @classmethod
    def between(cls, ours: Solution, theirs: Solution | Trace) -> "Deviation":
        """That of a run from another along the same trace, or from the samples of the trace itself."""
        position, pressure = (_difference(ours, theirs, name) for name in COMPARED)
        sizes = [(float(np.sqrt(np.mean(each**2))), float(np.max(np.abs(each)))) for each in (position, pressure)]
        return cls(*sizes[0], *sizes[1])


@dataclasses.dataclass(frozen=True, eq=False)
class Validation:
    """Several models along one bench trace.

    `measured` is the trace less the offsets of its sensors; `solutions` and `deviations` have the names of the models.
    """

    measured: Trace
    solutions: dict[str, Solution]
    deviations: dict[str, Deviation]


def deviation(
    model: AbstractModel, reference: AbstractModel, trace: Trace, *, stepping: AbstractStepping | None = None
) -> Deviation:
    """How far `model` is from `reference`, usually the full actuator, along a trace.

    **Raises:** as [`simulate`][] does.
    """
    return Deviation.between(*(simulate(which, trace, stepping=stepping) for which in (model, reference)))


def validate(
    models: Mapping[str, AbstractModel], trace: Trace, *, stepping: AbstractStepping | None = None
) -> Validation:
    """Models beside what was measured [section 5.2.3].

    A sensor's offset is not known: the mean error of the first model, which is the best one, stands for it, and the
    same offset is taken from what all are compared with.

    **Raises:** `InputError` for a trace without position and pressure; as [`simulate`][] does.
    """
    if any(trace.sampled(name) is None for name in COMPARED):
        raise InputError(
            f"{trace.name}: a validation needs the columns x_d and p_act, but one of them is missing; record both"
        )
    solutions = {name: simulate(model, trace, stepping=stepping) for name, model in models.items()}
    first = next(iter(solutions.values()))
    without_offset = {name: trace.channels[name].value + _difference(first, trace, name).mean() for name in COMPARED}
    measured = trace.replace(**without_offset)
    return Validation(measured, solutions, {name: Deviation.between(run, measured) for name, run in solutions.items()})


def validation_traces(interval: float = 1e-3, reservoir: float = ASSUMED_RESERVOIR) -> tuple[Trace, ...]:
    """Duty steps to 50 and 80 % and back (Figs. 5.4 and 5.5), and a ramp to 100 % and back (Fig. 5.6).

    **Arguments:** `interval` between samples in s, `reservoir` in Pa absolute.
    """
    traces = []
    for level in (50.0, 80.0):
        time = np.arange(0.0, 2.5, interval)
        traces.append((f"step_{level:.0f}", time, np.where((time >= 0.1) & (time < 1.5), level, 0.0)))
    time = np.arange(0.0, RAMP_SECONDS, interval)
    traces.append(("ramp", time, 100.0 * (1 - np.abs(2 * time / RAMP_SECONDS - 1))))
    return tuple(Trace(t, pwm=pwm, p_res=np.full_like(t, reservoir), name=name) for name, t, pwm in traces)


def _difference(ours: Solution, theirs: Solution | Trace, name: str) -> Float[np.ndarray, " samples"]:
    signal = np.asarray(getattr(ours, name))
    if isinstance(theirs, Trace):
        sampled = theirs.sampled(name)
        assert sampled is not None, "both signals are asked for before"
        return signal[theirs.rows(name)] - sampled.value
    return signal - np.asarray(getattr(theirs, name))
