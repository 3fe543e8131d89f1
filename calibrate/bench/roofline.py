"""What the operations of a step would take by themselves, beside what it takes."""

import collections
import re
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

PLAIN = ("add", "subtract", "multiply", "maximum", "minimum", "compare", "select", "negate", "abs", "and", "or")
"""In a compiled program; a core does one of them about as fast as another."""
SLOW: dict[str, Callable[[Any, Any], Any]] = {
    "divide": lambda x, v: v / (x + 1),
    "sqrt": lambda x, v: jnp.sqrt(x + v),
    "exponential": lambda x, v: jnp.exp(-x * v),
    "log": lambda x, v: jnp.log(x * x + v),
}
CHAINS, TERMS, ELEMENTS = 8, 64, 8192
"""Independent chains of dependent terms, so that none waits for another, over as many numbers as a cache holds."""
STREAM = 1 << 22
"""Numbers that are read and written where memory is measured."""
CALLS, ROUNDS = 20, 5


def processor_time(run: Callable[[], Any]) -> float:
    """s of all processors that a call takes, the best of some rounds of many."""
    jax.block_until_ready(run())
    spent = []
    for _ in range(ROUNDS):
        began = time.process_time()
        jax.block_until_ready([run() for _ in range(CALLS)])
        spent.append((time.process_time() - began) / CALLS)
    return min(spent)


def operations(text: str) -> dict[str, int]:
    """How often each kind of operation is in a compiled program, in which every line has one; all plain ones as one."""
    found = collections.Counter(re.findall(r"= \S+ ([a-z-]+)\(", text))
    return {"plain": sum(found[name] for name in PLAIN), **{name: found[name] for name in SLOW}}


def operation_times(dtype: DTypeLike) -> dict[str, float]:
    """s of a processor for one operation of each kind, by itself and on vectors in its caches."""
    values = jnp.full(ELEMENTS, 0.5, dtype)
    count = CHAINS * TERMS * ELEMENTS
    # A multiplication and an addition are two.
    found = {"plain": _time_of(lambda x, v: x * v + 1e-3, values) / (2 * count)}
    return {**found, **{name: _time_of(law, values) / count for name, law in SLOW.items()}}


def byte_time(dtype: DTypeLike) -> float:
    """s of a processor for a byte that goes to memory or comes from there."""
    values = jnp.ones(STREAM, dtype)
    return processor_time(partial(jax.jit(lambda values: 1.5 * values), values)) / (2 * values.nbytes)


def _time_of(law: Callable[[Any, Any], Any], values: jax.Array) -> float:
    def chains(values):
        terms = [values * (1 + 0.01 * number) for number in range(CHAINS)]
        for _ in range(TERMS):
            terms = [law(term, values) for term in terms]
        return sum(terms)

    return processor_time(partial(jax.jit(chains), values))
