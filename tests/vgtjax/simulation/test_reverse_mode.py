"""Steps whose number is no part of what is compiled, taken back by reverse mode."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax.simulation import CountedMarch
from vgtjax.simulation._stepping import ROOM, FixedMarch


@pytest.fixture(scope="module")
def interval(actuator):
    """A state in motion, and the inputs of an interval in which the duty reaches the valve late."""
    trace = duty_trace((0, 0.02), (80, 0.08), interval=20e-3, p_res=20000.0)
    bundle = jax.tree.map(jnp.asarray, vgtjax.estimation.bundle_traces(actuator, [trace])[0])
    drive = bundle.with_late_duty(jnp.asarray(5e-3))[0].drive
    begin = jax.tree.map(lambda leaf: leaf[2, 0], drive)
    return actuator.start(trace.start(), begin), begin


def slopes(plan, actuator, interval):
    """Derivatives of the end of an interval with respect to all parameters."""
    state, drive = interval

    def end(model):
        return sum(leaf / 1e3 for leaf in jax.tree.leaves(plan.advance(model, state, drive)[0]))

    return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(jax.jit(jax.grad(end))(actuator))])


@pytest.mark.parametrize("substeps", [ROOM - 1, ROOM + 8])
def test_counted_steps_have_the_derivatives_of_a_fixed_number(actuator, interval, substeps):
    plan = CountedMarch(np.asarray(substeps)).reversible()
    assert plan.room > substeps  # one more where the duty changes on the way
    plan = jax.tree.map(jnp.asarray, plan)
    exact = slopes(FixedMarch(substeps), actuator, interval)
    # The same operations in the same order but for those that fusion rounds otherwise, over forty steps.
    np.testing.assert_allclose(slopes(plan, actuator, interval), exact, rtol=1e-9, atol=1e-12 * np.max(np.abs(exact)))
    assert np.count_nonzero(exact) > 15
