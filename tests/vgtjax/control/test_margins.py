"""Margins of loops: against closed forms, and against what a loop does when they are used up."""

import dataclasses
import math

import jax
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import LinearLoop, LoadBackstepping, Scenario, Sine, linearise_loop, margins

PERIOD, GAIN = 1e-3, 300.0


def integrator(gain, period=PERIOD):
    """`L = k T / (z - 1)`."""
    return LinearLoop(np.ones((1, 1)), np.array([period]), np.array([-gain]), period)


def delayed(loop, samples):
    """The loop whose answer arrives so many samples later."""
    states = len(loop.entry)
    transition = np.zeros((states + samples, states + samples))
    transition[:states, :states], transition[states, :states] = loop.transition, loop.exit
    transition[range(states + 1, states + samples), range(states, states + samples - 1)] = 1.0
    entry, exit_ = np.zeros(states + samples), np.zeros(states + samples)
    entry[:states], exit_[-1] = loop.entry, 1.0
    return LinearLoop(transition, entry, exit_, loop.period)


def test_a_sampled_integrator_has_the_margins_of_its_closed_form():
    """`|L| = kT / (2 sin(wT/2))`, whose phase is -90 degrees less half a sample."""
    found, share = margins(integrator(GAIN)), 0.5 * GAIN * PERIOD
    crossover = 2 / PERIOD * math.asin(share)
    lead = math.pi / 2 - 0.5 * crossover * PERIOD
    # Brent's method finds crossings to 1e-12 of the rate.
    assert found.crossover == pytest.approx(crossover, rel=1e-9)
    assert found.phase == pytest.approx(math.degrees(lead), rel=1e-9)
    assert found.delay == pytest.approx(lead / crossover, rel=1e-9)
    assert found.gain == pytest.approx(1 / share, rel=1e-9)
    assert found.reduction == 0
    # At half the sampling rate, the last of the frequencies.
    assert found.sensitivity == pytest.approx(1 / (1 - share), rel=1e-9)
    assert found.radius == pytest.approx(1 - GAIN * PERIOD)
    assert found.stable


def test_a_loop_that_is_not_stable_has_no_margins():
    found = margins(integrator(2.1 / PERIOD))
    assert not found.stable
    assert found.radius == pytest.approx(1.1)
    assert math.isnan(found.gain)
    assert math.isnan(found.phase)


@pytest.mark.parametrize(("growth", "stands"), [(1e-15, True), (1e-6, False)])
def test_what_a_controller_keeps_is_no_instability(growth, stands):
    """A state that nothing moves, with an eigenvalue of one but for rounding, leaves the margins as they are."""
    loop = integrator(GAIN)
    transition = np.diag([1.0, 1.0 + growth])
    kept = LinearLoop(transition, np.append(loop.entry, 0.0), np.append(loop.exit, 0.0), PERIOD)
    found = margins(kept)
    assert found.stable is stands
    if stands:
        assert found.gain == pytest.approx(margins(loop).gain, rel=1e-9)


def test_a_loop_whose_plant_is_unstable_bears_no_gain_below_its_reduction():
    """`L = k / (z - 2)` is stable for gains between 1 and 3."""
    found = margins(LinearLoop(np.full((1, 1), 2.0), np.ones(1), np.array([-1.5]), PERIOD))
    assert found.gain == pytest.approx(2.0)
    assert found.reduction == pytest.approx(1 / 1.5, rel=1e-6)  # at a frequency of 6e-5 rad a sample instead of none


@pytest.fixture(scope="module")
def loop(actuator):
    """Along a sine, in its middle, going up."""
    scenario = Scenario(Sine(0.003, 4.0, 0.005), start=control.balanced_at(0.005), duty_before=55.0)
    loops = linearise_loop(actuator, LoadBackstepping.for_plant(actuator), scenario, [0.785, 1.57])
    return jax.tree.map(lambda leaf: leaf[1], loops)


def test_a_loop_is_at_its_limit_where_a_margin_is_used_up(loop):
    """An identity: what is a factor of the answer, or a delay of it by whole samples, moves the same eigenvalues."""
    found = margins(loop)
    assert found.stable

    def radius(factor):
        return dataclasses.replace(loop, exit=factor * np.asarray(loop.exit)).spectral_radius

    # Within a thousandth of the limit to either side.
    assert radius(0.999 * found.gain) < 1 < radius(1.001 * found.gain)
    whole = math.floor(found.delay / loop.period)
    assert whole >= 1
    assert delayed(loop, whole).spectral_radius < 1 < delayed(loop, whole + 1).spectral_radius
    # The circle about -1 that L does not enter has these at least (Astrom and Murray).
    assert found.gain >= found.sensitivity / (found.sensitivity - 1)
    assert math.radians(found.phase) >= 2 * math.asin(0.5 / found.sensitivity) * (1 - 1e-3)


def test_a_loop_is_linearised_where_it_runs(actuator):
    with pytest.raises(vgtjax.InputError, match=r"at one or more times of a run, but they are \[-1.0\] s; give times"):
        linearise_loop(actuator, LoadBackstepping(), Scenario(Sine(0.003, 4.0, 0.005)), [-1.0])
