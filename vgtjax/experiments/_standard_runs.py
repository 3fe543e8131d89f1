"""Runs that a bench can record next: what drives the actuator in each."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..traces import ASSUMED_RESERVOIR, Trace

REST, LARGE = 0.2, 80.0
"""Seconds of no duty before every run, and percent of a large step."""
SHORTEST_HOLD, LONGEST_HOLD = 0.12, 0.9
"""Seconds that a random level of duty is held: the rod comes to rest on some, and not on others."""
LEVELS = (15.0, 95.0)
"""Percent between which random levels lie."""


@dataclasses.dataclass(frozen=True)
class StandardRun:
    """A run of a bench: `kind` is `step`, `levels` (random ones, held for random times), `ramp` (up and down within
    some seconds) or `slow loop` (the same over half a minute, with a turbine pressure in Pa gauge); `rate` in Hz."""

    kind: str
    seconds: float
    rate: float
    turbine_pressure: float = 0.0

    @property
    def label(self) -> str:
        """What to ask the bench for."""
        gas = f" at {self.turbine_pressure / 100:.0f} mbar" if self.turbine_pressure else ""
        return f"{self.kind}{gas}, {self.seconds:g} s at {self.rate:g} Hz"

    def trace(self, reservoir: float = ASSUMED_RESERVOIR, seed: int = 0) -> Trace:
        """Its inputs; `reservoir` in Pa absolute, `seed` of random levels."""
        time = np.arange(round(self.seconds * self.rate)) / self.rate
        duty = np.where(time < REST, 0.0, _DUTIES[self.kind](time - REST, self.seconds - REST, seed))
        supply, gas = (np.full_like(time, pressure) for pressure in (reservoir, self.turbine_pressure))
        return Trace(time, pwm=duty, p_res=supply, p_trb=gas, name=self.label)


STANDARD_RUNS = (
    StandardRun("step", 4.0, 1000.0),
    StandardRun("step", 4.0, 100.0),
    StandardRun("levels", 5.0, 1000.0),
    StandardRun("levels", 5.0, 500.0),
    StandardRun("levels", 5.0, 100.0),
    StandardRun("levels", 10.0, 1000.0),
    StandardRun("levels", 10.0, 500.0),
    StandardRun("levels", 10.0, 100.0),
    StandardRun("ramp", 10.0, 1000.0),
    StandardRun("ramp", 10.0, 100.0),
    StandardRun("slow loop", 30.0, 100.0),
)
"""Runs without exhaust gas that are compared with each other."""

Seconds = Float[np.ndarray, " time"]


def _step(time: Seconds, seconds: float, seed: int) -> Seconds:
    return np.where(time < 0.5 * seconds, LARGE, 0.0)


def _levels(time: Seconds, seconds: float, seed: int) -> Seconds:
    rng = np.random.default_rng(seed)
    holds = rng.uniform(SHORTEST_HOLD, LONGEST_HOLD, round(seconds / SHORTEST_HOLD))
    levels = np.round(rng.uniform(*LEVELS, len(holds)), 1)
    return levels[np.searchsorted(np.cumsum(holds), np.maximum(time, 0.0), side="right")]


def _up_and_down(time: Seconds, seconds: float, seed: int) -> Seconds:
    return 100.0 * (1 - np.abs(2 * np.clip(time / seconds, 0.0, 1.0) - 1))


_DUTIES = {"step": _step, "levels": _levels, "ramp": _up_and_down, "slow loop": _up_and_down}
