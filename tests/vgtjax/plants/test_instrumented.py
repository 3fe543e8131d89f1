"""A model behind its sensors: what they show is what a bench would have recorded, and nothing else changes."""

import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax import simulate
from vgtjax.plants import Gains, Instrumented, Offsets, bare

TRACE = duty_trace((0, 0.05), (70, 0.15), (40, 0.1), p_res=2.0e4)


def test_perfect_sensors_change_nothing(actuator):
    plain, seen = simulate(actuator, TRACE), simulate(Instrumented(actuator), TRACE)
    for name in ("x_d", "p_act", "v_d"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(plain, name))
    assert bare(Instrumented(actuator)) is actuator
    assert bare(actuator) is actuator


def test_names_are_those_of_the_model_and_its_sensors(actuator):
    names = list(vgtjax.parameter_table(Instrumented(actuator)))
    plain = list(vgtjax.parameter_table(actuator))
    assert names[: len(plain)] == plain
    assert set(names[len(plain) :]) >= {"gain.x_d", "gain.p_act", "offset.p_res"}
    assert vgtjax.select(Instrumented(actuator)).entries == vgtjax.select(actuator).entries  # all of them held


def test_an_input_that_shows_too_much_drives_with_what_was_there(actuator):
    """Of the reservoir, and of its gain."""
    shown = TRACE.replace(p_res=1.02 * TRACE.p_res + 400.0)
    behind = Instrumented(actuator, Gains(p_res=1.02), Offsets(p_res=400.0))
    expected, found = simulate(actuator, TRACE), simulate(behind, shown)
    np.testing.assert_allclose(found.x_d, expected.x_d, rtol=0, atol=1e-13)  # rounding of 2e4 Pa


def test_gains_are_in_what_is_observed_not_in_what_is_there(actuator):
    behind = Instrumented(actuator, Gains(x_d=1.03, p_act=0.98))
    drive = TRACE.drive()
    solution = simulate(behind, TRACE)
    last = lambda tree: [leaf[-2] for leaf in tree]  # noqa: E731
    assert last([solution.x_d])[0] == pytest.approx(float(simulate(actuator, TRACE).x_d[-2]), rel=1e-12)
    import jax

    state, inputs = (jax.tree.map(lambda leaf: leaf[-2], each) for each in (solution.states, drive))
    position, pressure = behind.observe(state, inputs)
    assert float(position) == pytest.approx(1.03 * float(solution.x_d[-2]), rel=1e-12)
    assert float(pressure) == pytest.approx(0.98 * float(solution.p_act[-2]), rel=1e-12)
