"""What a fit finds out besides the parameters: the delay of the duty, what the sensors' noise is like, and by how much
its own smooth model and steps are off.

A search uses the smooth model, whose derivatives can be believed. Where it ends, every trace is simulated once more
with the jump as it is and fine steps; the data less that difference are what the smooth model must meet (defect
correction, Stetter, 1978). What is left over tells the sensors' noise. A full linear step leads from there to where the
same is done again, until nothing moves: then the sharp model meets the data, and the smooth one has only told the way.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ..._errors import SimulationError
from ...plants import AbstractModel
from ...simulation import FixedStep, first_failure
from ...traces import Trace
from ..derivatives import CHANNELS, Bundle, Computation, Evaluated, Evaluation, ask, bundle_traces
from ._chatter import in_phase
from ._measured import SensorsOfTraces, white_sensors
from ._sensors import Samples, SensorNoise, learn_sensor

SHARP_STEP = 1e-4
"""s; the steps of what a model would give without numerical errors."""
LARGEST_DEFECT = 10.0
"""Deviations of a sensor's noise to which a correction is cut; more than that no fit should believe."""
LONGEST_DELAY = 0.05
"""s; a duty that is later, or earlier, is another fault than a delay."""
DELAY_SCALE = 1e-3
"""s; a delay of this size is a large but sane step."""
EVIDENT = 3.0
"""Standard errors by which a delay must differ from zero to be one."""
SETTLED = 0.2
"""Standard errors: corrections that move nothing by more have settled. The sharp model chatters by about a tenth."""
SMALL_GAIN = 1.0
"""Gain in chi^2 that full steps may still promise where no step moves anything: one standard error."""
MOST_CORRECTIONS = 10
SHORTEST = 1 / 64
"""Part of a correction below which no simulation that succeeds is looked for."""
NEARBY = 1.0
"""Standard errors by which a linear step may go wrong because its derivatives were taken elsewhere."""

Choice = Literal["evidence"] | bool


@dataclasses.dataclass(frozen=True)
class Unknown:
    """What a fit may find out besides the parameters; with `"evidence"` the traces decide.

    `duty_delay`: the time in s by which the duty reaches the valve later than its record says, one for all traces.
    `duty_hold`: whether the duty of a trace was held between samples, as it is read otherwise, or linear.
    `noise` is white or coloured, `loss` Gaussian, Huber's against outliers, or Student's against heavy tails; by
    evidence it is Huber's, which costs nothing where there are none. `numerics`: whether the errors of the smooth seat
    and of the steps are corrected for. `gain`: channels whose sensor may show more or less than is there, and `offset`:
    inputs whose sensor may show too much, each one value for all traces; the offsets of what is fitted are always free,
    for each trace. `start_state`: whether a trace begins elsewhere than at the means of its first 50 ms; by evidence
    those are asked that do not begin at rest and have a duty, and with `True` all. `input_noise`: whether the pressure
    that drives a rod has a sensor with noise, and with an offset that shows at rest.
    """

    duty_delay: Choice = "evidence"
    duty_hold: Literal["evidence", False] = "evidence"
    noise: Literal["evidence", "white", "coloured"] = "evidence"
    loss: Literal["evidence", "gaussian", "huber", "student"] = "evidence"
    numerics: bool = True
    gain: tuple[str, ...] = ()
    offset: tuple[str, ...] = ()
    start_state: Choice = "evidence"
    input_noise: bool = True

    @property
    def anything(self) -> bool:
        """Whether there is anything to correct a search for."""
        return bool(self.duty_delay) or self.noise != "white" or self.loss != "gaussian" or self.numerics


NOTHING = Unknown(
    duty_delay=False,
    duty_hold=False,
    noise="white",
    loss="gaussian",
    numerics=False,
    start_state=False,
    input_noise=False,
)
"""The parameters only."""


def turns(wanted: Float[np.ndarray, "steps coordinates"]) -> Int[np.ndarray, " turns"]:
    """Which of all full steps, in standard errors, turn back from the one before.

    Where the sharp model jumps, full steps would go to and fro. A half is taken of those after the first turn, a third
    after the second, and so on: these come to the middle (Kesten, 1958).
    """
    return np.flatnonzero(np.sum(wanted[1:] * wanted[:-1], axis=1) < 0) + 1


def simulated(evaluated: Evaluated, bundles: Sequence[Bundle], traces: Sequence[Trace]) -> Evaluated:
    """The answer for some traces.

    **Raises:** `SimulationError` naming the first of them whose simulation failed.
    """
    for trace, failure in zip(traces, map(first_failure, evaluated.results(bundles)), strict=True):
        if failure:
            raise SimulationError(
                f"the simulation of trace '{trace.name}' failed; check its inputs and the start values. {failure}"
            )
    return evaluated


def observe_traces(
    model: AbstractModel, bundles: Sequence[Bundle], traces: Sequence[Trace], delay: float | None = None
) -> Computation[list[Float[np.ndarray, "time channel"]]]:
    """What the sensors would see of every trace at its `time`: position in m, pressure in Pa absolute.

    **Arguments:** `bundles` of the traces; `delay` in s with which the duty reaches the valve.

    **Raises:** as [`simulated`][].
    """
    evaluated = simulated((yield from ask(Evaluation(model, bundles, delay))), bundles, traces)
    return by_trace(bundles, evaluated)


def by_trace(bundles: Sequence[Bundle], evaluated: Evaluated) -> list[Float[np.ndarray, "time channel"]]:
    """What is observed, trace by trace."""
    observed: dict[int, np.ndarray] = {}
    for bundle, lanes in zip(bundles, evaluated.observed, strict=True):
        observed |= dict(zip(bundle.indices, bundle.from_lanes(lanes), strict=True))
    return [observed[index] for index in range(len(observed))]


def sharp_bundles(model: AbstractModel, traces: Sequence[Trace], stepping: FixedStep) -> list[Bundle]:
    """Traces laid out for the fine steps of what a model would give without numerical errors."""
    return bundle_traces(model, traces, dataclasses.replace(stepping, max_step=min(stepping.max_step, SHARP_STEP)))


def learn_sensors(
    traces: Sequence[Trace],
    channels: Sequence[str],
    smooth: Sequence[np.ndarray],
    sharp: Sequence[np.ndarray],
    unknown: Unknown,
) -> SensorsOfTraces:
    """What a fit that ended at a smooth simulation tells of the sensors, and its sharp one of numerical errors.

    **Arguments:** `smooth`, `sharp`: what is observed of every trace, `(time, channel)`.
    """
    sensors = white_sensors(traces, channels)

    def learn(index: int, channel: str, sensor: SensorNoise) -> SensorNoise:
        rows, at = traces[index].rows(channel), CHANNELS.index(channel)
        return _learn(sensor, smooth[index][rows, at], sharp[index][rows, at], unknown)

    return [{name: learn(index, name, each) for name, each in known.items()} for index, known in enumerate(sensors)]


def _learn(sensor: SensorNoise, smooth: Samples, sharp: Samples, unknown: Unknown) -> SensorNoise:
    """A sensor by what is left of its values, less the numerical errors of the smooth simulation."""
    defect = in_phase(sharp - smooth, sensor.values - smooth, sensor.deviation)
    largest = LARGEST_DEFECT * sensor.deviation
    corrected = dataclasses.replace(sensor, values=sensor.values - np.clip(defect, -largest, largest))
    coloured, loss = unknown.noise != "white", "huber" if unknown.loss == "evidence" else unknown.loss
    # No sensor is better than its record: a tenth of what its signal shows, or a perfect fit would weigh infinitely.
    least = 0.1 * sensor.deviation
    return learn_sensor(corrected, corrected.values - smooth, least, coloured=coloured, loss=loss)
