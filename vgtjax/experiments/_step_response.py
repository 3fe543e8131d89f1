"""The step of the duty from rest, held, and released: how fast, and where it ends (section 2.3)."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._types import Scalar
from ..plants import AbstractModel
from ..simulation import check_result, simulate
from ..traces import Trace
from ._base import LONGEST, AbstractExperiment, Output, Readings, first_reach
from ._loops import LIFT

INTERVAL = 2e-3
"""s between samples; linear between them, a response of 0.1 s is read to some microseconds."""
REST = 0.1
"""s before the step, at rest."""
RELEASE = 1.5
"""s after the duty went off again."""
SHARES = (0.63, 0.95)
"""Of the final position, at which response times are read."""
SHOWN = 51
"""Points of the curves over time."""
DUTIES, HOLD = (50.0, 80.0), 2.4
"""In % and s, by default."""


class StepResponse(AbstractExperiment):
    """Steps of the duty to each of `duties` percent, held for `hold` seconds, then off.

    Response times count from the step until the position has gone 63 or 95 % of its own way, the release time from
    the end of the step until it has come back 63 %; all are NaN where the rod does not leave its rest by `LIFT`. The
    steady error is where the position ends, less `target` in m for each duty: what a controller that knows only the
    nominal actuator would be wrong by. [`around`][vgtjax.experiments.StepResponse.around] takes targets from that.
    """

    duties: tuple[float, ...] = eqx.field(static=True, default=DUTIES)
    hold: float = eqx.field(static=True, default=HOLD)
    target: Float[Array, " duties"] = eqx.field(converter=jnp.asarray, kw_only=True)

    def __check_init__(self) -> None:
        named = {f"{duty:g}" for duty in self.duties}
        if not named or len(named) < len(self.duties) or not all(0 < duty <= 100 for duty in self.duties):
            raise InputError(
                "steps need one or more different duties above 0 up to 100 %, but they are "
                f"{list(self.duties)}; correct them"
            )
        if not 0.5 <= self.hold <= LONGEST:
            raise InputError(f"a step must be held for 0.5 s to an hour, but hold is {self.hold:g} s; correct it")
        if self.target.shape != (len(self.duties),):
            raise InputError(
                f"there must be one target a duty, but there are {self.target.size} for {len(self.duties)}; give both"
            )

    @classmethod
    def around(cls, model: AbstractModel, duties: tuple[float, ...] = DUTIES, hold: float = HOLD) -> "StepResponse":
        """Steps whose targets are the final positions of a nominal actuator.

        **Raises:** `InputError` for such duties or such a time, `SimulationError` when one of the steps fails.
        """
        response = cls(duties, hold, target=jnp.zeros(len(duties)))
        ends = []
        for duty, trace in zip(duties, response.traces, strict=True):
            run = simulate(model, trace, throw=False)
            run = check_result(run, run.result, f"the nominal actuator's step to {duty:g} %")
            ends.append(run.x_d[_sample(REST + hold)])
        return cls(duties, hold, target=jnp.stack(ends))

    @property
    def traces(self) -> tuple[Trace, ...]:
        """A step from rest for every duty."""
        time = np.arange(round((REST + self.hold + RELEASE) / INTERVAL) + 1) * INTERVAL
        samples = np.arange(len(time))
        on = (samples >= _sample(REST)) & (samples < _sample(REST + self.hold))
        return tuple(Trace(time, pwm=np.where(on, duty, 0.0), name=f"step_{duty:g}") for duty in self.duties)

    @property
    def outputs(self) -> tuple[Output, ...]:
        """For every duty: times, the steady error, and position and pressure over time."""
        found: list[Output] = []
        times = tuple((self._shown * INTERVAL - REST).tolist())
        for duty in self.duties:
            at = f"{duty:g}"
            found += [
                *[
                    Output(f"response_time_{share:.0%}_{at}".replace("%", ""), "s", f"time to {share:.0%} at {at} %")
                    for share in SHARES
                ],
                Output(f"release_time_{at}", "s", f"time to come back {SHARES[0]:.0%} from {at} %"),
                Output(f"steady_error_{at}", "m", f"final position at {at} % less that of the nominal actuator"),
                Output(f"step_position_{at}", "m", f"position after a step to {at} %", times, "s"),
                Output(f"step_pressure_{at}", "Pa", f"chamber pressure after a step to {at} %", times, "s"),
            ]
        return tuple(found)

    def read(self, x_d: Float[Array, "runs time"], p_act: Float[Array, "runs time"], ambient: Scalar) -> Readings:
        """See the base class."""
        found: Readings = {}
        for run, duty in enumerate(self.duties):
            at = f"{duty:g}"
            *times, release, final = self._times(x_d[run])
            for share, time in zip(SHARES, times, strict=True):
                found[f"response_time_{share:.0%}_{at}".replace("%", "")] = time
            found[f"release_time_{at}"] = release
            found[f"steady_error_{at}"] = final - self.target[run]
            found[f"step_position_{at}"] = x_d[run, self._shown]
            found[f"step_pressure_{at}"] = p_act[run, self._shown] - ambient
        return found

    @property
    def _shown(self) -> np.ndarray:
        """Samples of the curves: evenly from the step to its end."""
        return np.round(np.linspace(_sample(REST), _sample(REST + self.hold) - 1, SHOWN)).astype(int)

    def _times(self, x_d: Float[Array, " time"]) -> list[Array]:
        """Response times, release time, and the final position."""
        on, off = _sample(REST), _sample(REST + self.hold)
        elapsed = jnp.arange(len(x_d), dtype=x_d.dtype) * INTERVAL
        rest, final = x_d[on], x_d[off]
        # A rod that only unloads its stop has not moved, and has no time to do so.
        way = jnp.where(final - rest > LIFT, final - rest, jnp.nan)
        pulled, released = x_d[on : off + 1], x_d[off:]
        out = [first_reach(pulled, elapsed[: len(pulled)], rest + share * way) for share in SHARES]
        back = first_reach(-released, elapsed[: len(released)], -(final - SHARES[0] * way))
        return [*out, back, final]


def _sample(seconds: float) -> int:
    return round(seconds / INTERVAL)
