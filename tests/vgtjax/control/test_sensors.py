"""Sensors: statistics of the noise, quantisation, offset, and no noise at all."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import Measurement, Sensor, Sensors
from vgtjax.control.surroundings._sensors import quantise

TRUTH = Measurement(*(jnp.asarray(value) for value in (5e-3, 6e4, 2e4, 1.01e5, 1.5e5)))
SAMPLES = 20_000


def readings(sensors, seed=0):
    return jax.vmap(lambda deviates: sensors(TRUTH, deviates))(sensors.draw(jax.random.key(seed), SAMPLES))


def test_ideal_sensors_tell_exactly_the_truth():
    found = readings(Sensors.ideal())
    for name in ("position", "pressure", "reservoir", "ambient", "turbine"):
        np.testing.assert_array_equal(getattr(found, name), getattr(TRUTH, name))


def test_the_assumed_sensors_have_white_noise_of_8_um_and_60_pa():
    found = readings(Sensors.bench())
    for name, deviation in (("position", 8e-6), ("pressure", 60.0), ("reservoir", 60.0)):
        noise = np.asarray(getattr(found, name)) - float(getattr(TRUTH, name))
        # Five standard errors: of a mean s / sqrt(n), of a deviation s / sqrt(2 n), of a correlation 1 / sqrt(n).
        assert abs(noise.mean()) < 5 * deviation / SAMPLES**0.5
        assert abs(noise.std() - deviation) < 5 * deviation / (2 * SAMPLES) ** 0.5
        assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 5 / SAMPLES**0.5
    position, pressure = np.asarray(found.position), np.asarray(found.pressure)
    assert abs(np.corrcoef(position, pressure)[0, 1]) < 5 / SAMPLES**0.5
    # Rounding of some 1e5 Pa in double precision.
    np.testing.assert_allclose(position / 1e-6, np.round(position / 1e-6), atol=1e-9)
    np.testing.assert_allclose(pressure / 3.1, np.round(pressure / 3.1), atol=1e-9)
    np.testing.assert_array_equal(found.turbine, TRUTH.turbine)


def test_a_key_is_a_seed():
    once, again, other = (np.asarray(readings(Sensors.bench(), seed).position) for seed in (1, 1, 2))
    np.testing.assert_array_equal(once, again)
    # Five standard errors, as above.
    assert abs(np.corrcoef(once, other)[0, 1]) < 5 / SAMPLES**0.5


def test_quantised_readings_are_the_nearest_multiples():
    sensors = Sensors(Sensor(noise=8e-6, offset=1e-4, quantum=1e-5), Sensor(quantum=7.0), Sensor())
    found = readings(sensors)
    steps = np.asarray(found.position) / 1e-5
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(np.unique(np.round(steps))) > 3
    # Noise of nearly a step dithers: the mean is the truth plus the offset, and rounding adds a variance of 1/12 step.
    assert abs(np.mean(found.position) - 5.1e-3) < 5 * 8e-6 / SAMPLES**0.5
    np.testing.assert_allclose(np.std(found.position), np.hypot(8e-6, 1e-5 / 12**0.5), rtol=0.03)
    np.testing.assert_array_equal(found.pressure, 7.0 * round(6e4 / 7.0))


def test_the_derivative_goes_straight_through_a_quantiser():
    value, slope = jax.jvp(lambda x: quantise(3 * x, jnp.asarray(0.5)), (jnp.asarray(0.4),), (jnp.asarray(1.0),))
    assert float(value) == 1.0
    assert float(slope) == 3.0
    assert float(jax.grad(lambda x: quantise(3 * x, jnp.asarray(0.5)))(0.4)) == 3.0


def test_negative_noise_is_refused():
    with pytest.raises(vgtjax.InputError, match=r"noise of a sensor must not be negative, but it is -1\.0"):
        Sensor(noise=-1.0)
    with pytest.raises(vgtjax.InputError, match="quantum of a sensor must not be negative"):
        Sensor(quantum=-1e-5)
