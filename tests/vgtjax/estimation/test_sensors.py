"""What residuals tell of a sensor: white noise stays white, coloured noise is whitened, outliers lose their weight."""

import numpy as np
import pytest
import scipy.signal

from vgtjax.estimation import Sensor
from vgtjax.estimation._sensors import innovations, learn_sensor

COUNT, SIZE = 20_000, 8e-6


def learn(noise, **choices):
    sensor = Sensor(np.zeros(len(noise)), SIZE, np.zeros(0), np.ones(len(noise)))
    return learn_sensor(sensor, noise, 1e-9, **{"coloured": True, "robust": True, **choices})


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
    found = learn(noise, coloured=False, robust=False)
    assert len(found.memory) == 0
    assert np.all(found.trust == 1.0)


def test_a_record_without_noise_keeps_a_least_deviation():
    assert learn(np.zeros(1000)).deviation == 1e-9
