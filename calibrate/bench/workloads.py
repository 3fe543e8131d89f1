"""What is timed under other settings of JAX as well: plain ones, or other numbers of devices."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, PyTree

import vgtjax

from .data import example_traces, lengthened, reference

SECONDS = 10.0
"""Length of the trace of the forward and batch benchmarks."""
HELD = ("diaphragm.stop_damping",)
"""Held in the Jacobian's benchmark: 25 of the 26 parameters that a fit frees by default remain."""

LANES, BATCH_SECONDS = 4096, 0.2
"""Actuators side by side, and s that each is simulated for."""


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


def exact_jacobian() -> Callable[[], Any]:
    """The exact Jacobian of the example's traces."""
    model, traces = vgtjax.Actuator(), example_traces()
    return lambda: vgtjax.jacobian(model, traces, fixed=HELD)


def batch() -> Callable[[], Any]:
    """Printed actuators whose stiffness differs, shared out to all devices; their last positions."""
    trace, nominal = lengthened(reference("levels").trace, BATCH_SECONDS), vgtjax.Actuator()
    repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (LANES, *leaf.shape)), nominal)
    stiffness = nominal.diaphragm.stiffness * jnp.linspace(0.9, 1.1, LANES)
    population = share(eqx.tree_at(lambda model: model.diaphragm.stiffness, repeated, stiffness))
    run = jax.jit(jax.vmap(lambda model: vgtjax.simulate(model, trace, throw=False).x_d[-1]))
    return lambda: run(population)


def share(models: PyTree[Array]) -> PyTree[Array]:
    """Models shared out to all devices along the leading axis of their arrays."""
    lanes = NamedSharding(Mesh(np.asarray(jax.devices()), ("lane",)), PartitionSpec("lane"))
    return eqx.filter_shard(models, lanes)


WORKLOADS: dict[str, Callable[[], Callable[[], Any]]] = {
    "forward": forward,
    "forward-mode": forward_mode,
    "jacobian": exact_jacobian,
    "batch": batch,
}
"""By the name that the process with other settings is given."""
