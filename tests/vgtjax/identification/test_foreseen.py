"""Programs that are compiled beside the tests of an identification are those that its fits ask for."""

import jax
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax.estimation.derivatives import _programs
from vgtjax.identification import _pipeline

LEVELS = ((0, 0.2), (80, 0.6), (30, 0.6), (100, 0.4))


@pytest.fixture(scope="module")
def traces(actuator):
    """Two runs at different rates."""
    rng, found = np.random.default_rng(0), []
    for interval in (1e-3, 4e-3):
        trace = duty_trace(*LEVELS, interval=interval, p_res=20000.0)
        run = vgtjax.simulate(actuator, trace)
        noise = {"x_d": 8e-6 * rng.normal(size=len(trace.time)), "p_act": 60.0 * rng.normal(size=len(trace.time))}
        found.append(trace.replace(**{name: np.asarray(getattr(run, name)) + each for name, each in noise.items()}))
    return found


def programs(question):
    """What tells the programs of a question apart: what is no array, and the shapes of arrays."""
    for each in question:
        for arguments in each.arguments():
            leaves, structure = jax.tree.flatten(arguments)
            yield structure, tuple((np.shape(leaf), np.asarray(leaf).dtype) for leaf in leaves)


@pytest.mark.parametrize("test", list(_pipeline.FORESEEN))
def test_what_a_fit_asks_first_has_been_foreseen(test, actuator, traces, monkeypatch):
    asked = []

    def note(question):
        asked.extend(programs(question))
        raise vgtjax.SimulationError("that is enough")

    monkeypatch.setattr(_programs, "_answer_alone", note)
    assert not test(actuator, traces).values
    foreseen = [each for question in _pipeline.FORESEEN[test](actuator, traces) for each in programs(question)]
    assert asked
    assert all(each in foreseen for each in asked)


@pytest.mark.parametrize("test", list(_pipeline.FORESEEN))
def test_traces_that_tell_nothing_have_nothing_foreseen(test, actuator):
    bare = duty_trace(*LEVELS)
    assert not list(_pipeline.FORESEEN[test](actuator, [bare]))
