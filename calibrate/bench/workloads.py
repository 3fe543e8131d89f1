"""What is timed both under this package's settings and under plain JAX ones."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

import vgtjax

from .data import example_traces, lengthened, reference

SECONDS = 10.0
"""Length of the trace of the forward and batch benchmarks."""
HELD = ("diaphragm.stop_damping",)
"""Held in the Jacobian's benchmark: 25 of the 26 parameters that a fit frees by default remain."""


def forward_trace() -> vgtjax.Trace:
    """The reference's duty levels repeated to the length of the benchmark."""
    return lengthened(reference("levels").trace, SECONDS)


def forward() -> Callable[[], Any]:
    """One simulation, compiled whole: position and pressure of the printed actuator."""
    model, trace = vgtjax.Actuator(), forward_trace()

    @jax.jit
    def run(model):
        solution = vgtjax.simulate(model, trace)
        return solution.x_d, solution.p_act

    return lambda: run(model)


def forward_mode(traces: Sequence[vgtjax.Trace] | None = None) -> Callable[[], list[jax.Array]]:
    """`jax.jacfwd` straight through the simulation, each trace compiled on its own: `(time, 2, parameters)`."""
    model = vgtjax.Actuator()
    selection = vgtjax.select(model, fixed=HELD)
    theta = selection.pack(model)

    def compiled(trace: vgtjax.Trace) -> Callable[[jax.Array], jax.Array]:
        def seen(theta):
            solution = vgtjax.simulate(selection.unpack(model, theta), trace, throw=False)
            return jnp.stack([solution.x_d, solution.p_act], axis=-1)

        return jax.jit(jax.jacfwd(seen))

    functions = [compiled(trace) for trace in (example_traces() if traces is None else traces)]
    return lambda: [function(theta) for function in functions]


WORKLOADS: dict[str, Callable[[], Callable[[], Any]]] = {"forward": forward, "forward-mode": forward_mode}
"""By the name that the process with plain settings is given."""
