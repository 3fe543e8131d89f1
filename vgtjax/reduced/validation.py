"""How far a reduced model is from the full one (section 5.2.3)."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..integrate import AbstractStepping
from ..model import AbstractModel
from ..simulate import simulate
from ..trace import ASSUMED_RESERVOIR, Trace

RAMP_SECONDS = 20.0
"""s; the slow ramp of duty, up and down."""


@dataclasses.dataclass(frozen=True)
class Deviation:
    """Root mean square and peak of the difference between two models along a trace: m and Pa."""

    position_rmse: float
    position_peak: float
    pressure_rmse: float
    pressure_peak: float


def deviation(
    model: AbstractModel, reference: AbstractModel, trace: Trace, *, stepping: AbstractStepping | None = None
) -> Deviation:
    """How far `model` is from `reference`, usually the full actuator, along a trace.

    **Raises:** as [`simulate`][] does.
    """
    ours, theirs = (simulate(which, trace, stepping=stepping) for which in (model, reference))
    position, pressure = ours.x_d - theirs.x_d, ours.p_act - theirs.p_act
    return Deviation(_rms(position), _peak(position), _rms(pressure), _peak(pressure))


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


def _rms(values: Float[np.ndarray, " time"]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _peak(values: Float[np.ndarray, " time"]) -> float:
    return float(np.max(np.abs(values)))
