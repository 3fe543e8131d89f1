"""What a compiled program is said to consist of."""

import jax
import jax.numpy as jnp

from calibrate.bench.roofline import operations


def test_operations_of_a_compiled_program_are_counted():
    def law(x, y):
        return jnp.sqrt(x * y) / (jnp.log(x) - jnp.exp(y))

    # Copies for loops of their own don't occur: it is one expression of which every value is used once.
    counted = operations(jax.jit(law).lower(jnp.ones(16), jnp.ones(16)).compile().as_text())
    assert counted == {"plain": 2, "divide": 1, "sqrt": 1, "exponential": 1, "log": 1}
