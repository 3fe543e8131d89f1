"""References and other signals: values, three derivatives, and what they refuse."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import Constant, FadeIn, Ramps, Sampled, Sine, Steps, reference_at, signal_1, signal_2

GRID = np.linspace(0.0, 2.0, 21)
SIGNALS = {
    "constant": Constant(0.004),
    "sine": Sine(amplitude=0.003, rate=5.0, offset=0.004, phase=0.3),
    "steps": Steps(times=[0.2, 1.0, 1.2], levels=[0.004, 0.001, 0.006], rise=0.5),
    "ramps": Ramps(times=[0.3, 0.9, 1.6], levels=[0.001, 0.005, 0.002], rounding=0.4),
    "fade in": FadeIn(Sine(amplitude=0.003, rate=5.0), at=0.2, rise=0.7),
    "sampled": Sampled.through(GRID, 0.004 + 0.002 * np.sin(4 * GRID)),
}


@pytest.mark.parametrize("at", [0.0, 0.7, 2.0])
def test_a_sampled_signal_has_its_derivatives_from_the_first_sample_to_the_last(at):
    signal = Sampled.through(GRID, 0.002 + 0.01 * GRID + 0.02 * GRID**2)
    reference = reference_at(signal, jnp.asarray(at))
    assert float(reference.velocity) == pytest.approx(0.01 + 0.04 * at, rel=1e-6)
    assert float(reference.acceleration) == pytest.approx(0.04, rel=1e-6)


@pytest.mark.parametrize("signal", SIGNALS.values(), ids=SIGNALS.keys())
def test_each_derivative_is_the_slope_of_the_one_before(signal):
    time, step = jnp.linspace(0.05, 1.95, 191), 1e-5

    @jax.jit
    def at(time):
        reference = jax.vmap(lambda t: reference_at(signal, t))(time)
        return [reference.position, reference.velocity, reference.acceleration, reference.jerk]

    below, here, above = at(time - step), at(time), at(time + step)
    np.testing.assert_allclose(here[0], jax.vmap(signal)(time), atol=1e-15)
    for order, (value, slope) in enumerate(itertools.pairwise(range(4))):
        measured = (above[value] - below[value]) / (2 * step)
        size = max(float(np.max(np.abs(here[slope]))), 1e-9)
        # Rounding of 1e-16 over a step of 1e-5, and the kink that a jerk may have; each order is some ten times larger.
        np.testing.assert_allclose(measured, here[slope], atol=2e-4 * size, err_msg=f"derivative {order + 1}")


def test_steps_hold_their_levels_and_join_smoothly():
    steps = SIGNALS["steps"]
    values = jax.vmap(steps)(jnp.array([0.0, 0.2, 0.71, 0.99, 5.0]))
    np.testing.assert_allclose(values, [0.0, 0.0, 0.004, 0.004, 0.006], atol=1e-15)
    # The jerk starts from zero: no derivative jumps where a step begins or ends.
    for edge in (0.2, 0.7):
        around = [float(reference_at(steps, jnp.asarray(edge + offset)).jerk) for offset in (-1e-6, 1e-6)]
        assert abs(around[1] - around[0]) < 1e-3  # m/s3; a step of degree five would jump by 1.9


def test_ramps_are_straight_away_from_their_corners():
    ramps = SIGNALS["ramps"]
    time = np.array([0.0, 0.05, 0.55, 0.6, 1.2, 1.85, 3.0])
    expected = np.interp(time, [0.3, 0.9, 1.6], [0.001, 0.005, 0.002])
    np.testing.assert_allclose(jax.vmap(ramps)(jnp.asarray(time)), expected, atol=1e-15)
    assert float(reference_at(ramps, jnp.asarray(0.6)).velocity) == pytest.approx(0.004 / 0.6, rel=1e-12)


def test_sampled_signals_pass_through_their_samples_and_hold_their_ends():
    signal = SIGNALS["sampled"]
    np.testing.assert_allclose(jax.vmap(signal)(jnp.asarray(GRID)), 0.004 + 0.002 * np.sin(4 * GRID), atol=1e-15)
    between = np.linspace(0, 2, 333)
    # A spline of degree five on this grid: (4 rad/s * 0.1 s)^6 / 60 of the amplitude, less in the middle.
    np.testing.assert_allclose(jax.vmap(signal)(jnp.asarray(between)), 0.004 + 0.002 * np.sin(4 * between), atol=2e-7)
    np.testing.assert_allclose(signal(jnp.asarray(9.0)), 0.004 + 0.002 * np.sin(8.0), atol=1e-15)


def test_the_thesis_signals_are_as_printed_once_they_have_begun():
    time = np.array([1.0, 5.0, 12.566, 40.0])
    np.testing.assert_allclose(
        jax.vmap(signal_1())(jnp.asarray(time)), 0.005 * np.sin(0.125 * time) + 0.005, atol=1e-15
    )
    assert float(signal_1()(jnp.asarray(0.0))) == 0.0
    values = jax.vmap(signal_2())(jnp.array([0.0, 2.999, 3.25, 3.5, 20.0]))
    np.testing.assert_allclose(values, [0.0, 0.0, 0.004, 0.008, 0.008], atol=1e-15)
    sharp = jax.vmap(signal_2(rise=1e-6))(jnp.array([2.9999, 3.0001]))
    np.testing.assert_array_equal(sharp, [0.0, 0.008])


def test_signals_that_differ_in_numbers_form_a_batch():
    batch = jax.vmap(lambda amplitude: Sine(amplitude, rate=5.0)(jnp.asarray(0.1)))(jnp.array([0.001, 0.002]))
    np.testing.assert_allclose(batch, np.array([0.001, 0.002]) * np.sin(0.5), rtol=1e-15)


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: Steps(times=[1.0, 2.0], levels=[0.001]), "times and levels must have one level a time"),
        (lambda: Ramps(times=1.0, levels=0.001), "times and levels must have one level a time"),
        (lambda: Steps(times=[1.0], levels=[0.001], rise=0.0), "rise must be a positive number of seconds"),
        (lambda: Ramps(times=[1.0], levels=[0.1], rounding=-1.0), "rounding must be a positive number of seconds"),
        (lambda: Ramps(times=[2.0, 1.0], levels=[0.1, 0.2]), "times of corners must increase, but they are"),
        (lambda: FadeIn(Constant(1.0), rise=0.0), "rise must be a positive number of seconds"),
        (lambda: Sampled.through(GRID[:5], GRID[:5]), "needs at least 6 values at increasing times"),
        (lambda: Sampled.through(GRID[::-1], GRID), "needs at least 6 values at increasing times"),
    ],
)
def test_impossible_signals_are_refused(build, sentence):
    with pytest.raises(vgtjax.InputError, match=sentence):
        build()
