"""Figures of merit that are read off runs: steps, observed pressure; and controllers on what was measured before."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax import control
from vgtjax.control import (
    PI,
    PROBES,
    Backstepping,
    Scenario,
    Sensors,
    Sine,
    channels_used,
    close_loop,
    pressure_rms,
    replay,
    step_answers,
)
from vgtjax.parts.vane_force import ForcePolynomial

TIME = np.arange(4001) * 1e-3
STEPPED = np.where(TIME < 1.0, 0.002, np.where(TIME < 3.0, 0.008, 0.004))
"""Jumps of 6 and -4 mm, at the samples after 0.999 s and 2.999 s."""


@pytest.fixture(scope="module")
def run(actuator):
    scenario = Scenario(
        Sine(0.001, 10.0, 0.004), start=control.balanced_at(0.004), duty_before=51.0, sensors=Sensors.bench()
    )
    return close_loop(actuator, Backstepping.for_plant(actuator), scenario, 0.3)


def lag(constant, ring=0.0):
    """A rod that goes to each level like `exp(-t/T)`, and swings beyond it by a share `ring`."""
    position = np.full_like(TIME, 0.002)
    for begin, before, level in ((0.999, 0.002, 0.008), (2.999, 0.008, 0.004)):
        since = np.maximum(TIME - begin, 0.0)
        gone = np.exp(-since / constant) * np.cos(ring / constant * since)
        position = np.where(begin <= TIME, level + (before - level) * gone, position)
    return position


class Misspelt(PI):
    """Says that it observes the pressure, and logs another name."""

    @property
    def observes(self):
        return frozenset({"pressure"})

    def update(self, state, measurement, reference, period):
        onward, command, log = super().update(state, measurement, reference, period)
        return onward, command, {**log, "presure": measurement.pressure}


class Silent(PI):
    """Logs a pressure, and does not say that it observes it."""

    def update(self, state, measurement, reference, period):
        onward, command, log = super().update(state, measurement, reference, period)
        return onward, command, {**log, "pressure": measurement.pressure}


@pytest.mark.parametrize(
    ("controller", "said"),
    [
        (Misspelt(), "Misspelt names pressure, and it logs nothing"),
        (Silent(), "Silent names nothing, and it logs press"),
    ],
)
def test_what_is_observed_is_what_is_logged(actuator, controller, said):
    scenario = Scenario(Sine(0.001, 10.0, 0.004), start=control.balanced_at(0.004), duty_before=51.0)
    with pytest.raises(vgtjax.InputError, match=f"must name what it logs of pressure, velocity_error, but.*{said}"):
        close_loop(actuator, controller, scenario, 0.01)


def test_what_nobody_observes_is_no_name(run):
    assert run.observes == {"pressure", "velocity_error"}
    with pytest.raises(vgtjax.InputError, match="observes pressure, velocity_error, but no presure; use one of these"):
        run.observed("presure")


def test_settling_times_are_those_of_a_lag():
    """`T log(height / band)`, to a sample."""
    first, second = step_answers(TIME, STEPPED, lag(0.05))
    assert (first.begin, second.begin) == (0.999, 2.999)
    assert (first.height, second.height) == pytest.approx((0.006, -0.004))
    assert first.settling_time == pytest.approx(0.05 * np.log(60), abs=1e-3)
    assert second.settling_time == pytest.approx(0.05 * np.log(40), abs=1e-3)
    assert first.overshoot == second.overshoot == 0.0


def test_overshoot_is_beyond_the_level_either_way():
    """The first swing of `exp(-s) cos(a s)` beyond zero."""
    ring = 4.0
    swing = -np.min(np.exp(-(s := np.linspace(0, 5, 100_001))) * np.cos(ring * s))
    for answer in step_answers(TIME, STEPPED, lag(0.05, ring)):
        assert answer.overshoot == pytest.approx(abs(answer.height) * swing, rel=1e-3)


def test_a_rod_that_stays_away_never_settles():
    first, second = step_answers(TIME, STEPPED, np.where(TIME < 2.5, lag(0.05), 0.0))
    assert first.settling_time == np.inf
    assert second.settling_time == np.inf
    assert second.overshoot == pytest.approx(0.004)


def test_only_steps_that_end_at_rest_are_answered():
    assert step_answers(TIME, 0.005 * np.sin(TIME), TIME) == []
    assert len(step_answers(TIME, STEPPED, lag(0.05), hold=1.5)) == 1


def test_pressure_is_judged_where_one_is_observed(run, actuator):
    late = np.asarray(run.time) >= 0.1
    error = np.asarray(run.pressure - run.log["pressure"])[late]
    assert float(pressure_rms(run, 0.1)) == pytest.approx(np.sqrt(np.mean(error**2)))
    blind = dataclasses.replace(run, log={}, observes=frozenset())
    assert np.isnan(pressure_rms(blind))


def test_a_replay_repeats_the_run(run, actuator):
    command, log = replay(Backstepping.for_plant(actuator), run.measured, run.reference, 1e-3)
    # Compiled apart from the plant: rounding, amplified by the loop's gains.
    np.testing.assert_allclose(command, run.command, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(log["pressure"], run.log["pressure"], rtol=1e-6)


def test_channels_that_a_controller_uses_are_found_out(run, actuator):
    short = jax.tree.map(lambda leaf: leaf[:50], (run.measured, run.reference))
    used = {
        name: channels_used(controller, *short, 1e-3)
        for name, controller in {
            "alone": PI(),
            "balance": PI.for_plant(actuator),
            "adaptive": control.AdaptiveBackstepping(),
            "blind": control.ConstantDuty(50.0),
        }.items()
    }
    assert used == {
        "alone": ("position",),
        "balance": ("position", "reservoir"),
        "adaptive": ("position", "pressure"),
        "blind": (),
    }
    assert set(PROBES) == {field.name for field in dataclasses.fields(run.measured)} - {"ambient"}


def test_gas_is_measured_by_a_controller_that_knows_vanes(run, actuator):
    short = jax.tree.map(lambda leaf: leaf[:50], (run.measured, run.reference))
    gas = dataclasses.replace(short[0], turbine=jnp.full_like(short[0].position, 1e5))
    knowing = control.FrictionCompensation(vane_force=ForcePolynomial())
    assert channels_used(knowing, gas, short[1], 1e-3) == ("position", "reservoir", "turbine")
    assert "turbine" not in channels_used(control.FrictionCompensation.for_plant(actuator), gas, short[1], 1e-3)
