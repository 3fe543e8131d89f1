"""What is known of a sensor: its noise, how that is correlated in time, and which samples are outliers."""

import dataclasses
from typing import Literal

import numpy as np
import scipy
from jaxtyping import Float

from ...traces import Channel, Trace, noise_level, robust_deviation

MEMORY = 6
"""Longest memory in samples of a coloured noise: the order of its autoregression."""
CLIP = 4.0
"""Deviations at which residuals are cut where their correlation is estimated, which outliers would hide."""
OUTLIER = 3.0
"""Deviations beyond which a residual counts by its size instead of its square (Huber, 1964). Of white normal noise that
costs 0.2 % of the information."""
FAR_OUT = 5.0
"""Deviations beyond which a sample may be an outlier that says nothing: one in two million of normal noise."""
NEIGHBOURS = 10
"""Samples on either side of which most must be none: what many in a row say is the fault of the model."""

FREEDOM = 4.0
"""Degrees of freedom of Student's distribution as a loss: few enough that a sample of thirty deviations weighs a two
hundredth, and a sixteenth of the information of normal noise is lost (Lange, Little and Taylor, 1989)."""
FREQUENCIES = 2000
"""At which the spectrum of a noise is summed: more than the samples that it remembers."""
SLOWEST_FILTER = 20.0
"""Hz; a slower filter of a position or a pressure would make steps late by more than a period of the duty's PWM."""
MOST_TURNS, ROUNDING = 100, 1e-9
"""Turns of the scale of Student's distribution, each of which halves what is left to go, and the last of them."""

Samples = Float[np.ndarray, " samples"]
Loss = Literal["gaussian", "huber", "student"]


@dataclasses.dataclass(frozen=True, eq=False)
class SensorNoise:
    """One channel of one trace as a fit weighs it.

    `values` in m or Pa at the channel's valid samples; `deviation` in the same unit of what is new in every sample;
    `memory` is the autoregression `e[k] = sum(memory[i] e[k-1-i]) + new[k]` of its noise, empty for white noise;
    `trust` multiplies the weight of every sample: one, less where residuals are large, zero for outliers. `worth` is
    the part of its samples that counts as measurements: less than one where a loss gives up information.
    """

    values: Samples
    deviation: float
    memory: Float[np.ndarray, " order"]
    trust: Samples
    worth: float = 1.0

    @property
    def count(self) -> int:
        """Number of samples that say something."""
        return round(self.worth * int(np.count_nonzero(self.trust)))

    @property
    def level(self) -> float:
        """Standard deviation of the noise itself, in m or Pa."""
        return self.deviation * float(np.sqrt(_gain_of_memory(self.memory)))

    @property
    def cost(self) -> float:
        """What the likelihood of its samples has beside their weighed squares: by the size of what is new in each, and
        of an outlier what the largest residual costs that is none, so that no unit of the signal speaks for calling
        a sample one."""
        outliers = int(np.count_nonzero(self.trust == 0))
        return 2 * len(self.trust) * float(np.log(self.deviation)) + outliers * OUTLIER * FAR_OUT

    @property
    def outliers(self) -> float:
        """Share of the samples that are outliers."""
        return float(np.mean(self.trust == 0))


def white_sensor(trace: Trace, channel: str) -> SensorNoise | None:
    """A channel with white noise of the size that its own signal shows; `None` where a trace lacks it."""
    sampled = trace.sampled(channel)
    if sampled is None:
        return None
    return SensorNoise(sampled.value, noise_level(sampled.value, channel), np.zeros(0), np.ones(len(sampled.value)))


def noise_to_meet(sensor: SensorNoise, measured: Channel, name: str) -> float:
    """The noise in m or Pa that what remains of a channel is compared with.

    That which the signal itself shows between neighbours. Noise behind a filter shows too little of itself there, so
    that it is as it was learned from what remains, if its memory is so short that a sensor's filter may make it. A
    model that lacks something leaves noise with a longer memory, and none but white noise may excuse that.
    """
    coloured = len(sensor.memory) > 0 and _filter_frequency(sensor.memory, measured.time) >= SLOWEST_FILTER
    return sensor.level if coloured else noise_level(measured.value, name)


def left_over_noise(sensor: SensorNoise, measured: Channel, name: str, residuals: Samples) -> float:
    """The root mean square of what remains of a channel, in units of `noise_to_meet`: without outliers, of which one in
    two hundred would double it."""
    return float(np.std(residuals[sensor.trust > 0])) / noise_to_meet(sensor, measured, name)


def _filter_frequency(memory: Float[np.ndarray, " order"], time: Samples) -> float:
    """Hz of the low-pass of first order behind which noise has the same integral of its correlations."""
    interval = float(np.median(np.diff(time)))
    integral = interval / (_gain_of_memory(memory) * (1 - float(np.sum(memory))) ** 2)
    return 1 / (np.pi * integral)


def learn_sensor(sensor: SensorNoise, residuals: Samples, least: float, *, coloured: bool, loss: Loss) -> SensorNoise:
    """What the residuals of a fit tell of a sensor.

    The order of the autoregression is that of the least Bayesian information criterion (Schwarz, 1978), so that white
    noise stays white.

    **Arguments:** `residuals` in the sensor's unit; `least` its smallest deviation, so that a record without noise does
    not get an infinite weight; `coloured`: whether noise may have a memory; `loss`: how large residuals count.
    """
    centred = residuals - np.median(residuals)
    memory = _autoregression(centred) if coloured else np.zeros(0)
    new = innovations(centred, memory)
    deviation = max(robust_deviation(new), least)
    learned = dataclasses.replace(sensor, deviation=deviation, memory=memory, trust=np.ones(len(new)))
    if loss == "student":
        return _by_student(learned, new / deviation, least / deviation)
    return learned if loss == "gaussian" else dataclasses.replace(learned, trust=_trust(np.abs(new) / deviation))


def _by_student(sensor: SensorNoise, sizes: Samples, least: float) -> SensorNoise:
    """A sensor whose noise is taken for Student's, of a scale that its residuals in deviations tell best.

    Weights alone would claim too much: of `FREEDOM` degrees of freedom seven measurements are worth five. What they are
    worth is read from the residuals themselves, so that errors are right for normal noise too (Huber, 1981, 7.6).
    """
    scale = 1.0
    if np.all(np.abs(sizes) < least):
        return sensor  # nothing remains of a record without noise
    for _ in range(MOST_TURNS):
        square = (sizes / scale) ** 2
        factor = float(np.sqrt(np.mean((FREEDOM + 1) / (FREEDOM + square) * square)))
        if abs(factor - 1) < ROUNDING or scale * factor < least:
            break
        scale *= factor
    square = (sizes / scale) ** 2
    weights = (FREEDOM + 1) / (FREEDOM + square)
    bend = np.mean((FREEDOM + 1) * (FREEDOM - square) / (FREEDOM + square) ** 2)  # of the influence, over size
    variance = float(np.mean((weights * sizes) ** 2) / bend**2)
    worth = float(np.mean(weights * sizes**2) / (np.mean(weights) * variance))
    return dataclasses.replace(sensor, trust=np.sqrt(weights / (np.mean(weights) * variance)), worth=worth)


def _trust(sizes: Samples) -> Samples:
    """Factors of residuals of these sizes in deviations."""
    usual = scipy.ndimage.median_filter(sizes, 2 * NEIGHBOURS + 1, mode="nearest")
    alone = (sizes > FAR_OUT) & (usual < OUTLIER)
    return np.where(alone, 0.0, np.sqrt(OUTLIER / np.maximum(sizes, OUTLIER)))


def innovations(residuals: Samples, memory: Float[np.ndarray, " order"]) -> Samples:
    """What is new in every residual; the first ones, which have no past, in the size that this has."""
    if not len(memory):
        return residuals
    new = np.convolve(residuals, np.concatenate([[1.0], -memory]))[: len(residuals)]
    new[: len(memory)] = residuals[: len(memory)] / np.sqrt(_gain_of_memory(memory))
    return new


def _autoregression(residuals: Samples) -> Float[np.ndarray, " order"]:
    """Yule and Walker's equations of the order, up to `MEMORY`, that describes residuals with the fewest numbers."""
    count, scale = len(residuals), robust_deviation(residuals)
    if count < 100 or scale == 0.0:
        return np.zeros(0)
    cut = np.clip(residuals, -CLIP * scale, CLIP * scale)
    cut = cut - cut.mean()
    covariances = np.array([cut[lag:] @ cut[: count - lag] for lag in range(MEMORY + 1)]) / count
    best, least = np.zeros(0), count * np.log(covariances[0])
    for order in range(1, MEMORY + 1):
        memory = scipy.linalg.solve_toeplitz(covariances[:order], covariances[1 : order + 1])
        left = max(covariances[0] - memory @ covariances[1 : order + 1], 1e-12 * covariances[0])
        criterion = count * np.log(left) + order * np.log(count)
        if criterion < least:
            best, least = memory, criterion
    return best


def _gain_of_memory(memory: Float[np.ndarray, " order"]) -> float:
    """Variance of a noise per variance of what is new in it: the mean of its spectrum, by Parseval's theorem."""
    if not len(memory):
        return 1.0
    return float(np.mean(np.abs(np.fft.fft(np.concatenate([[1.0], -memory]), FREQUENCIES)) ** -2.0))
