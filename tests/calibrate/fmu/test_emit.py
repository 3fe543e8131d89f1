"""What is emitted as C gives what JAX gives."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from calibrate.fmu.emit import emit_function
from calibrate.fmu.primitives import PRELUDE, literal
from vgtjax import InputError

X = np.array([0.7, -1.3, 2.5, 0.0])


def table(x):
    """A row of a table at a place that is known only when it runs."""
    place = jnp.sum(x > 0)
    return lax.dynamic_slice(jnp.reshape(jnp.arange(8.0), (4, 2)) * x[0], (place, 1), (1, 1))[0]


def bisection(x):
    """Carries two numbers that change places, and an array."""

    def body(carry, each):
        low, high, seen = carry
        return (high, low + each, seen + low), low * high

    (low, high, seen), products = lax.scan(body, (x[0], x[1], x[:2]), x)
    return [low, high, *seen, *products]


def newton(x):
    return lax.while_loop(lambda root: jnp.abs(root * root - 2.0) > 1e-9, lambda y: 0.5 * (y + 2.0 / y), x[2])


def gathered(x):
    """Rows and columns of a table at places that are known only when it runs."""
    places, rows = jnp.array([0, 2]) + jnp.sum(x > 2), jnp.reshape(jnp.arange(8.0), (4, 2)) * x[0]
    return [rows[places], rows.T[:, places], x[places[::-1]]]


def scattered(x):
    place = jnp.sum(x > 0)
    return [x.at[1].set(9.0), x.at[place].add(x[2]), jnp.reshape(x, (2, 2)).at[:, place - 1].set(x[:2])]


def products(x):
    square = jnp.reshape(jnp.arange(8.0), (2, 4))
    return [square @ x, jnp.outer(x, x[:2]), x @ x, square @ square.T]


FUNCTIONS = {
    "arithmetic": lambda x: [x[0] + x[1] * x[2] - x[0] / x[2], -x[1], jnp.abs(x[1]), jnp.sign(x[1]), jnp.sign(x[3])],
    "functions": lambda x: [jnp.exp(x), jnp.tanh(x), jnp.sqrt(x[:1]), jnp.log(x[2:3]), jnp.log1p(x[:1]), jnp.expm1(x)],
    "angles": lambda x: [jnp.sin(x), jnp.cos(x), jnp.arctan2(x[:1], x[1:2])],
    "powers": lambda x: [x**2, x[:3] ** -3, x**7, jnp.abs(x[:3]) ** 1.7],
    "choices": lambda x: [jnp.where(x > 0, x, 2 * x), jnp.maximum(x, 0.5), jnp.minimum(x, 0.5), jnp.clip(x, -1.0, 1.0)],
    "truth": lambda x: jnp.where((x > 0) & ~(x > 1) | (x == -1.3), 1.0, 0.0),
    "not a number": lambda x: [jnp.maximum(jnp.nan * x, 1.0), jnp.where(jnp.isfinite(1 / x), 1.0, 2.0)],
    "rearranged": lambda x: [jnp.concatenate([x[1:], x[:1]]), jnp.flip(x), jnp.reshape(x, (2, 2)).T.ravel()],
    "sums": lambda x: [jnp.sum(jnp.reshape(x, (2, 2)), axis=0), jnp.max(x), jnp.min(x), jnp.prod(x[:3])],
    "inner programs": lambda x: [jax.jit(jnp.square)(x), jax.nn.relu(x), jax.checkpoint(jnp.exp)(x)],
    "put together": lambda x: [jnp.stack([x, 2 * x], axis=1), *jnp.unstack(x[:2]), *jnp.split(x, [1])],
    "padded": lambda x: [
        lax.pad(x, 0.5, [(1, 2, 1)]),
        lax.pad(x, 0.5, [(-1, 2, 0)]),
        lax.pad(jnp.reshape(x, (2, 2)), 0.5, [(0, 1, 0), (1, -1, 2)]),
    ],
    "products": products,
    "a table": table,
    "gathered": gathered,
    "scattered": scattered,
    "between knots": lambda x: jnp.interp(x, jnp.array([-2.0, 0.0, 1.0, 3.0]), jnp.array([1.0, 2.0, 4.0, 8.0])),
    "a loop of a length": bisection,
    "a loop until": newton,
    "branches": lambda x: lax.switch(jnp.sum(x > 0), [jnp.sin, jnp.cos, lambda y: 2 * y], x),
    "a condition": lambda x: lax.cond(x[0] > 1, lambda y: y, lambda y: y[::-1], x),
}


def flat(function):
    return lambda x: [each for part in jax.tree.leaves(function(x)) for each in jnp.ravel(part)]


@pytest.fixture(scope="module")
def call(load):
    """All of them in one library."""
    functions = [emit_function(f"f{i}", flat(each), {"x": X}) for i, each in enumerate(FUNCTIONS.values())]
    return load("\n".join([PRELUDE, *functions]))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_c_gives_what_jax_gives(call, name):
    expected = np.array(flat(FUNCTIONS[name])(jnp.asarray(X)))
    found = call(f"f{list(FUNCTIONS).index(name)}", len(expected), X)
    np.testing.assert_allclose(found, expected, rtol=1e-14)  # XLA has an exponential of its own


@pytest.mark.parametrize("value", [0.1, -0.0, 1e-300, 5e-324, math.pi, -1.7976931348623157e308, math.inf, -math.inf])
def test_a_number_in_c_is_the_same_double(load, value):
    source = f"{PRELUDE}\nVG_LOCAL void f(double x, double *out) {{ out[0] = x * 0 + {literal(value)}; }}\n"
    found = load(source)("f", 1, 1.0)[0]
    assert found == value


def test_what_no_result_needs_is_left_out():
    assert "exp" not in emit_function("f", lambda x: [jnp.exp(x) * 0 + 1, x[0]][1:], {"x": X})


def test_an_unknown_primitive_is_refused_by_its_name():
    sentence = "no C is known for JAX's primitive 'sort', which is used here; take another component or controller"
    with pytest.raises(InputError, match=sentence):
        emit_function("f", lambda x: jnp.sort(x), {"x": X})
