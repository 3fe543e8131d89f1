"""What residuals tell of a sensor: white noise stays white, coloured noise is whitened, outliers lose their weight."""

import numpy as np
import pytest
import scipy.signal

from vgtjax.estimation import SensorNoise
from vgtjax.estimation.measurements._sensors import innovations, learn_sensor, noise_to_meet
from vgtjax.traces import Channel

COUNT, SIZE = 20_000, 8e-6


def learn(noise, **choices):
    sensor = SensorNoise(np.zeros(len(noise)), SIZE, np.zeros(0), np.ones(len(noise)))
    return learn_sensor(sensor, noise, 1e-9, **{"coloured": True, "loss": "huber", **choices})


def low_pass(hertz, rate=1000.0, seed=0):
    """Noise of `SIZE` behind a first-order low pass."""
    keep = np.exp(-2 * np.pi * hertz / rate)
    noise = scipy.signal.lfilter([1 - keep], [1, -keep], np.random.default_rng(seed).normal(size=COUNT + 1000))[1000:]
    return keep, noise * SIZE / np.std(noise)


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_stays_white(seed):
    found = learn(np.random.default_rng(seed).normal(0, SIZE, COUNT))
    assert len(found.memory) == 0
    # Three standard errors of a deviation by the median: 1.17 / sqrt(2 n) a piece.
    assert found.level == pytest.approx(SIZE, rel=0.025)
    assert found.outliers == 0.0


def test_noise_behind_a_low_pass_is_whitened():
    keep, noise = low_pass(40.0)
    found = learn(noise)
    assert len(found.memory) >= 1
    # Four standard errors of a correlation of neighbours.
    assert np.sum(found.memory) == pytest.approx(keep, abs=4 * np.sqrt((1 - keep**2) / COUNT) + 0.01)
    assert found.level == pytest.approx(SIZE, rel=0.05)
    new = innovations(noise, found.memory)
    assert abs(new[1:] @ new[:-1]) / (new @ new) < 4 / np.sqrt(COUNT)


def test_outliers_count_for_nothing_and_spoil_neither_level_nor_memory():
    rng = np.random.default_rng(5)
    noise = rng.normal(0, SIZE, COUNT)
    far = rng.choice(COUNT, 60, replace=False)
    noise[far] += 30 * SIZE * rng.choice([-1, 1], 60)
    found = learn(noise)
    assert len(found.memory) == 0
    assert found.level == pytest.approx(SIZE, rel=0.03)
    assert found.outliers == pytest.approx(60 / COUNT, rel=0.1)
    assert np.all(found.trust[far] == 0)


def test_what_many_neighbours_say_is_no_outlier():
    """A model that misses a transient must hear of it: large residuals in a row count by their size (Huber)."""
    noise = np.random.default_rng(6).normal(0, SIZE, COUNT)
    noise[5000:5040] += 30 * SIZE
    found = learn(noise, coloured=False)
    assert np.median(found.trust[5000:5040] ** 2) == pytest.approx(0.1, rel=0.1)  # three deviations over thirty
    assert found.outliers == 0


def test_what_is_not_asked_for_is_not_learned():
    _, noise = low_pass(40.0)
    noise[100] = 1.0
    found = learn(noise, coloured=False, loss="gaussian")
    assert len(found.memory) == 0
    assert np.all(found.trust == 1.0)


@pytest.mark.parametrize(("freedom", "gain"), [(4, 1.43), (1000, 0.96)])
def test_students_loss_claims_the_error_that_a_mean_has(freedom, gain):
    """Over many records of a constant, of heavy tails and of noise that is all but normal.

    By Fisher's information a mean loses 43 % more to heavy tails, and Student's loss 4 % of normal noise.
    """
    rng, count, means, claims = np.random.default_rng(7), 400, [], []
    for noise in rng.standard_t(freedom, (400, count)):
        mean = float(np.median(noise))
        for _ in range(4):
            sensor = SensorNoise(noise, 1.0, np.zeros(0), np.ones(count))
            found = learn_sensor(sensor, noise - mean, 1e-9, coloured=False, loss="student")
            weights = (found.trust / found.deviation) ** 2
            mean = float(weights @ noise / np.sum(weights))
        chi2 = weights @ (noise - mean) ** 2
        assert chi2 == pytest.approx(found.count, rel=0.02)  # as of any good model
        means.append(mean)
        claims.append(np.sqrt(chi2 / (found.count - 1) / np.sum(weights)))
    assert np.std(np.array(means) / claims) == pytest.approx(1.0, abs=0.11)  # of 400 draws: three deviations
    usual = np.sqrt(freedom / (freedom - 2) / count)
    assert (usual / np.median(claims)) ** 2 == pytest.approx(gain, rel=0.1)


def test_students_loss_hardly_hears_outliers():
    noise = np.random.default_rng(5).normal(0, SIZE, COUNT)
    noise[::300] += 30 * SIZE
    found = learn(noise, loss="student")
    assert np.max(found.trust[::300] ** 2) < 0.02 * np.median(found.trust**2)


def test_a_record_without_noise_keeps_a_least_deviation():
    assert learn(np.zeros(1000)).deviation == 1e-9


def slow(times, seed=7):
    """White noise, and what a wrong model leaves: a misfit so many times as large, another one every half second."""
    rng, time = np.random.default_rng(seed), np.arange(COUNT) * 1e-3
    knots = np.arange(0, time[-1] + 1, 0.5)
    misfit = np.interp(time, knots, rng.normal(size=len(knots)))
    return rng.normal(0, SIZE, COUNT) + times * SIZE * misfit / np.std(misfit)


@pytest.mark.parametrize(
    ("remains", "ratio"),
    [
        (np.random.default_rng(8).normal(0, SIZE, COUNT), 1.0),
        (low_pass(40.0)[1], 1.0),
        (slow(1.0), np.sqrt(2)),
        (slow(5.0), np.sqrt(26)),
        (slow(20.0), np.sqrt(401)),
    ],
    ids=["white", "filter", "slow 1", "slow 5", "slow 20"],
)
def test_a_long_memory_is_no_excuse(remains, ratio):
    """Of a filter's noise that is met which was learned; of a misfit, which is learned as noise with a long memory,
    only what is white. Within a tenth: the level that neighbours show is known to 3 %, and a misfit adds to it."""
    time, motion = np.arange(COUNT) * 1e-3, 3e-3 * np.sin(np.arange(COUNT) * 2e-3)
    noise = noise_to_meet(learn(remains), Channel(time, motion + remains), "x_d")
    assert np.std(remains) / noise == pytest.approx(ratio, rel=0.1)


@pytest.mark.parametrize("last", [0.0, 1.0])
def test_a_record_that_hardly_moves_has_finite_weights(last):
    """Its residuals are equal but for one at most, so that a scale fitted to them goes to zero."""
    noise = np.append(np.zeros(49), last * SIZE)
    sensor = SensorNoise(np.zeros(50), SIZE, np.zeros(0), np.ones(50))
    found = learn_sensor(sensor, noise, 0.1 * SIZE, coloured=True, loss="student")
    # Without a floor of the scale not finite, or 1e101; a weight of 100 is a hundred times the least deviation.
    assert np.all(found.trust < 100)
