"""Simulations that fail in fits and derivatives, and what is said of them, also where all numbers are finite."""

import dataclasses

import diffrax
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax.estimation import (
    Evaluated,
    Evaluation,
    ask,
    bundle_traces,
    observe,
    plan_task,
    run_alone,
    run_together,
    start_calibration,
)
from vgtjax.parameters import select

FREE = ["diaphragm.stiffness"]
HOPELESS = vgtjax.FixedStep(solver=diffrax.ImplicitEuler(root_finder=diffrax.VeryChord(rtol=1e-14, atol=1e-14)))
"""One iteration a step never comes so close to the root."""
TRACE = duty_trace((0, 0.02), (80, 0.02), p_res=2.0e4, x_d=0.0, p_act=1.01e5).replace(name="short")
NO_ROOT = "The implicit solver did not find the root of a step"


def test_every_trace_says_how_it_ended(actuator):
    """The plunger rests in the first one, where the root is where the step begins."""
    resting = duty_trace((0, 0.02), (0, 0.02), p_res=2.0e4, x_d=0.0, p_act=1.01e5)
    (bundle,) = bundle_traces(actuator, [resting, TRACE], HOPELESS)
    observed, ended = observe(actuator, bundle)
    found = Evaluated([np.asarray(observed)], [], [ended])
    assert np.all(np.isfinite(observed))
    assert found.failed
    assert found.results([bundle])[1] == vgtjax.RESULTS.root_not_found


def test_a_root_that_is_not_found_leaves_no_derivatives(actuator):
    with pytest.raises(vgtjax.SimulationError, match=f"the simulation of trace 'short' failed: {NO_ROOT}"):
        vgtjax.jacobian(actuator, [TRACE], free=FREE, stepping=HOPELESS)


def test_nor_a_start_of_a_fit(actuator):
    with pytest.raises(vgtjax.SimulationError, match=f"nothing to fit from; .* {NO_ROOT}"):
        start_calibration(dataclasses.replace(plan_task(actuator, [TRACE], free=FREE), stepping=HOPELESS))


def test_what_a_sensor_shows_may_be_no_number(actuator):
    (bundle,) = bundle_traces(actuator, [TRACE])
    observed, ended = observe(actuator, bundle)
    found = Evaluated([np.full(observed.shape, np.nan)], [], [ended])
    assert found.results([bundle])[0] == vgtjax.RESULTS.no_number
    assert found.failure.startswith("What the sensors would see left the finite numbers")


@pytest.mark.parametrize("derivatives", [False, True])
def test_nothing_is_asked_of_no_trace(actuator, derivatives):
    """As of a fit without a trace to validate."""
    question = Evaluation(actuator, [], None, select(actuator, FREE) if derivatives else None)
    found, alone = [], run_alone(ask(question))
    run_together({"only": ask(question)}, lambda name, answer: found.append(answer))
    for answer in (alone, *found):
        assert (answer.observed, answer.columns, answer.failed, answer.results([])) == ([], [], False, [])
    assert len(found) == 1
