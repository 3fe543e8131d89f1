"""Every controller in C is the controller in JAX: sample by sample, on what it measured in a closed loop."""

import dataclasses

import jax
import numpy as np
import pytest
from support import EXAMPLE

import vgtjax
from calibrate.fmu.entries import values_of, with_values
from calibrate.fmu.law import MEASURED, WANTED, Law
from calibrate.study.start_file import load_model, read_parameters
from calibrate.tune.designs import DESIGNS, design_for
from vgtjax.control import PI, LostSensor, Scenario, Sensors, Sine, WithFallback, close_loop

UNIT = EXAMPLE / "fleet" / "units" / "unit_01" / "parameters.json"
PERIOD = 2e-3
DURATION = 0.6


@pytest.fixture(scope="module")
def plant() -> vgtjax.Actuator:
    return load_model(*read_parameters(UNIT))[1]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """Fast enough that the duty reaches its ends, with noise and gas."""
    return Scenario(
        Sine(amplitude=0.003, rate=15.0, offset=0.005), vgtjax.control.Constant(1.5e5), sensors=Sensors.bench()
    )


def columns(law: Law, run: vgtjax.control.ClosedLoop) -> np.ndarray:
    """The inputs at every sample, as C takes them."""
    found = {name: getattr(run.measured, field) for name, field in MEASURED.items()}
    found |= {name: getattr(run.reference, field) for name, field in WANTED.items()}
    return np.array(np.broadcast_arrays(*(found[name] for name in law.inputs))).T


def answers(load, law: Law, p: np.ndarray, us: np.ndarray) -> np.ndarray:
    """The outputs of C at every sample."""
    call, found = load(law.to_c()), []
    x = call("vg_start", len(law.memory), p, us[0])
    for u in us:
        result = call("vg_update", len(law.outputs) + len(x), p, u, x)
        found.append(result[: len(law.outputs)])
        x = result[len(law.outputs) :]
    return np.array(found)


def test_a_lost_position_is_answered_by_the_fallback_in_c_as_well(load, plant):
    """Not a number for some samples, and standing still for longer than the patience after them."""
    law = Law(WithFallback.for_plant(plant, controller=PI.for_plant(plant), patience=0.01), PERIOD)
    steps, times = 40, np.arange(40)
    position = 0.004 + 1e-5 * np.cos(times)
    position[10:13], position[20:35] = np.nan, 0.004
    given = {"x_d": position, "p_res": 2e4, "atmosphere": 101_013.0, "reference.position": 0.005}
    us = np.array(np.broadcast_arrays(*(given.get(name, 0.0) * np.ones(steps) for name in law.inputs))).T
    p = values_of(law.controller)
    found = answers(load, law, p, us)
    expected, memory = [], np.array(law.start(p, us[0]))
    update = jax.jit(law.update)
    for u in us:
        numbers = np.array(update(p, u, memory))
        expected.append(numbers[: len(law.outputs)])
        memory = numbers[len(law.outputs) :]
    # Rounding.
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    answered = found[:, law.outputs.index("log.fallback")]
    # It shows 4 mm at 20 first: five more samples of 2 ms are within the patience.
    assert answered.tolist() == [0.0] * 10 + [1.0] * 3 + [0.0] * 13 + [1.0] * 9 + [0.0] * 5


@pytest.mark.parametrize("name", DESIGNS)
def test_c_asks_for_the_duty_that_the_closed_loop_asks_for(load, plant, scenario, name):
    """With gains and beliefs other than those it was written for: they stay variables. Sensors fail at times."""
    written_for = design_for(name, plant, PERIOD)
    law = Law(written_for, PERIOD)
    p = values_of(written_for) * (1 + 0.01 * np.cos(np.arange(len(law.entries))))
    gaps = dataclasses.replace(
        scenario, disturbances=(LostSensor("position", 0.2, 0.21), LostSensor("pressure", 0.4, 0.42))
    )
    run = close_loop(plant, with_values(written_for, jax.numpy.asarray(p)), gaps, DURATION, period=PERIOD)
    assert np.sum(np.isnan(run.measured.position)) == 5
    found = answers(load, law, p, columns(law, run))
    assert law.outputs == ["pwm", "command", *(f"log.{each}" for each in sorted(run.log))]
    expected = [run.duty, run.command, *(run.log[each] for each in sorted(run.log))]
    for output, values, those in zip(law.outputs, found.T, expected, strict=True):
        # Rounding, as the same measurements went into both; of each output's own size.
        np.testing.assert_allclose(values, those, rtol=1e-9, atol=1e-9 * np.max(np.abs(those)), err_msg=output)
    assert np.ptp(run.duty) > 10


@pytest.mark.parametrize(
    ("name", "inputs"),
    [
        ("pi", "x_d p_res atmosphere reference.position"),
        (
            "adaptive-backstepping",
            "x_d p_act atmosphere reference.position reference.velocity reference.acceleration reference.jerk",
        ),
    ],
)
def test_an_input_is_what_a_design_looks_at(plant, name, inputs):
    assert list(Law(design_for(name, plant, PERIOD), PERIOD).inputs) == inputs.split()


class Sorting(vgtjax.control.ConstantDuty):
    """A controller of somebody who sorts."""

    def update(self, state, measurement, reference, period):
        return state, jax.numpy.sort(jax.numpy.stack([measurement.position, measurement.pressure]))[0], {}


def test_a_primitive_without_c_is_refused_by_its_name():
    with pytest.raises(
        vgtjax.InputError, match="no C is known for JAX's primitive 'sort', which is used here; take an"
    ):
        Law(Sorting(), PERIOD).to_c()
