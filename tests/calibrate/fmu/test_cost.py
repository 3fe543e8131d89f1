"""What a sample costs: operations counted, a time measured."""

import shutil

import jax.numpy as jnp
import numpy as np
from jax import lax

from calibrate.fmu.cost import count_operations, sample_cost
from calibrate.fmu.emit import emit_function
from vgtjax.control import PI, PID


def test_operations_in_a_loop_count_as_often_as_they_run():
    plain = emit_function("f", lambda x: [x[0] * x[1] + jnp.exp(x[0])], {"x": np.ones(2)})
    loop = emit_function("f", lambda x: [lax.fori_loop(0, 12, lambda _, y: y * x[0], x[1])], {"x": np.ones(2)})
    assert count_operations(plain) == 3
    assert 12 <= count_operations(loop) <= 2 * 12 + 1  # and the counter of the loop


def test_a_controller_has_a_cost():
    cost = sample_cost(PID(), 1e-3)
    # What a PID remembers, and the last position that was a number.
    assert (cost.memory, cost.parameters) == (3 + 1, 6)
    assert 10 < cost.operations < 100
    assert 0 < cost.seconds < 1e-4
    assert sample_cost(PI(), 1e-3).operations < cost.operations


def test_without_a_compiler_it_has_no_time(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert sample_cost(PI(), 1e-3).seconds is None
