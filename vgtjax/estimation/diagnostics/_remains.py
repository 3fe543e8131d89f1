"""What remains in the residuals of a fit: over time, over position, over speed, and in size."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import scipy
from jaxtyping import Float

from .._calibration import Calibration, TraceResult
from ..measurements import Samples, SensorNoise, innovations, noise_to_meet

LAGS = 10
"""Lags of Ljung and Box's statistic."""
BINS = 20
"""Bins of equally many samples over position and over speed."""
CHANCE = 1e-3
"""p value below which structure is evident."""
MUCH = 0.05
"""Share of the variance that evident structure may have before the model is far from its sensors' noise."""
LOUD = 1.5
"""The same for its size over the noise that the signals themselves show."""
VERDICTS = ("as of noise", "small but evident structure", "far from noise")
"""What residuals show, from nothing to much."""
WORDS = {"x_d": "position", "p_act": "chamber pressure"}


@dataclasses.dataclass(frozen=True)
class Remains:
    """One thing that residuals of a channel may show, all traces together.

    `over` is time, position, speed or size; `number` the share of the variance that is structure over it (of size: the
    noise that was found over that which the signals show); `p` the probability of as much by chance, `None` for size.
    `verdict` is one of `VERDICTS`.
    """

    channel: str
    over: str
    number: float
    p: float | None
    verdict: str
    sentence: str


def find_remains(calibration: Calibration) -> list[Remains]:
    """What remains in each fitted channel of a calibration.

    In the residuals without what their noise's memory tells: that of a sensor has one, and of a wrong model too.
    """
    found = []
    for channel in calibration.task.channels:
        pieces = list(_pieces(calibration, channel))
        if pieces:
            spread = _spread([new for _, new, _ in pieces])
            found += [_over_time(channel, pieces)]
            found += [_over(channel, what, read, pieces, spread) for what, read in _PLACES.items()]
            found += [_size(channel, pieces)]
    return found


Piece = tuple[TraceResult, Samples, SensorNoise]


def _pieces(calibration: Calibration, channel: str) -> Iterator[Piece]:
    """What is new in every residual of a channel, in deviations, trace by trace."""
    fitted = [result for result in calibration.traces if result.use == "fit"]
    for result, sensors in zip(fitted, calibration.sensors, strict=True):
        if channel in sensors and channel in result.channels:
            sensor = sensors[channel]
            residual = result.channels[channel].simulated - sensor.values
            new = innovations(residual - np.median(residual), sensor.memory) * sensor.trust / sensor.deviation
            yield result, new - new.mean(), sensor


def _correlations(new: Samples) -> Float[np.ndarray, " lags"]:
    whole = max(float(new @ new), 1e-300)
    return np.array([new[lag:] @ new[:-lag] / whole for lag in range(1, min(LAGS, len(new) - 1) + 1)])


def _spread(pieces: list[Samples]) -> float:
    """By how much correlation in time enlarges the variance of means."""
    count = sum(map(len, pieces))
    return max(1.0, sum(len(new) * (1 + 2 * float(np.sum(_correlations(new)))) for new in pieces) / count)


def _over_time(channel: str, pieces: list[Piece]) -> Remains:
    """Ljung and Box's statistic (1978)."""
    statistic = freedom = count = 0.0
    lag_1 = 0.0
    for _, new, sensor in pieces:
        rho, n = _correlations(new), len(new)
        if not len(rho):  # of a single sample
            continue
        statistic += n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, len(rho) + 1))))
        freedom += len(rho) - min(len(sensor.memory), len(rho) - 1)
        lag_1, count = lag_1 + n * float(rho[0]), count + n
    coloured = sum(len(sensor.memory) > 0 for _, _, sensor in pieces)
    more = f"; its noise was taken for coloured in {coloured} of {len(pieces)} traces" if coloured else ""
    if not count:
        freedom = count = 1.0  # nothing is known over time, so nothing speaks against noise
    text = f"correlation from sample to sample {lag_1 / count:.3f}"
    return _judged(channel, "time", statistic, freedom, count, text, more)


def _over(
    channel: str, what: str, read: Callable[[TraceResult, str], Samples], pieces: list[Piece], spread: float
) -> Remains:
    """Variance of the means of bins against that by chance."""
    new = np.concatenate([new for _, new, _ in pieces])
    at = np.concatenate([read(result, channel) for result, _, _ in pieces])
    edges = np.unique(np.quantile(at, np.linspace(0, 1, BINS + 1)))[1:-1]
    bins = np.searchsorted(edges, at)
    counts = np.maximum(np.bincount(bins, minlength=len(edges) + 1), 1)
    means = np.bincount(bins, new, len(counts)) / counts
    left = max(float(np.mean((new - means[bins]) ** 2)), 1e-300)
    statistic = float(np.sum(counts * means**2)) / left / spread
    text = f"means of {len(counts)} bins differ by {np.std(means):.3f} deviations of the noise"
    return _judged(channel, what, statistic, max(len(counts) - 1, 1), len(new) / spread, text, "")


def _judged(channel: str, what: str, statistic: float, freedom: float, count: float, text: str, more: str) -> Remains:
    p, share = float(scipy.special.chdtrc(freedom, statistic)), max(0.0, (statistic - freedom) / count)
    verdict = VERDICTS[(p < CHANCE) + (p < CHANCE and share > MUCH)]
    sentence = f"{WORDS[channel]} over {what}: {text}, {100 * share:.2g} % of its variance, {verdict}{more}"
    return Remains(channel, what, share, p, verdict, sentence)


def _size(channel: str, pieces: list[Piece]) -> Remains:
    """The noise that was found over that which sensors may have."""
    ratios = []
    for result, _, sensor in pieces:
        measured = result.trace.sampled(channel)
        assert measured is not None, "what is compared was measured"
        ratios.append(sensor.level / noise_to_meet(sensor, measured, channel))
    worst = int(np.argmax(ratios))
    verdict = VERDICTS[2 if ratios[worst] > LOUD else 0]
    sentence = (
        f"{WORDS[channel]}: what remains is at most {ratios[worst]:.2f} times the noise of its sensor "
        f"({pieces[worst][0].trace.name}), {verdict}"
    )
    return Remains(channel, "size", ratios[worst], None, verdict, sentence)


def _position(result: TraceResult, channel: str) -> Samples:
    return result.simulated["x_d"][result.trace.rows(channel)]


def _speed(result: TraceResult, channel: str) -> Samples:
    return np.gradient(result.simulated["x_d"], result.trace.time)[result.trace.rows(channel)]


_PLACES = {"position": _position, "speed": _speed}
