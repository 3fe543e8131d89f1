"""A thousand actuators at once: one device, all devices, and single precision, beside numba on all cores."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

import vgtjax

from .. import numba_plant
from ..data import rms
from ..table import Section, seconds, times
from ..timing import interleave
from ..workloads import SECONDS, forward_trace, share

ROUNDS = 5
ACTUATORS = 1024
SPREAD = {
    "diaphragm.stiffness": 0.02,
    "diaphragm.preload": 0.01,
    "friction.coulomb_force": 0.02,
    "chamber.volume": 0.02,
    "converter.reservoir_orifice_slope": 0.02,
}
"""Relative standard deviations within the population."""
COLUMNS = ("contestant", "first call", "time", "traces a second", "ratio", "x_d RMS um", "p_act RMS Pa")


def measure() -> Section:
    """Times the population in both precisions, on one device and on all, and by numba."""
    trace = forward_trace()
    population = _population()
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), population)
    thetas = np.asarray(jax.vmap(vgtjax.Selection(numba_plant.ENTRIES).pack)(population))
    run = _compile(trace)
    spread = f"jit(vmap(simulate)) over {jax.device_count()} devices"
    alone = "jit(vmap(simulate)) on one device"
    contestants: dict[str, Callable[[], Any]] = {
        f"{spread}, float64": partial(run, share(population)),
        f"{alone}, float64": partial(run, population),
        f"{spread}, float32": partial(run, share(single)),
        f"{alone}, float32": partial(run, single),
        "numba RK4 at 0.5 ms, prange, float64": lambda: numba_plant.simulate(thetas, trace, parallel=True),
    }
    timings, results = interleave(contestants, ROUNDS)
    section = Section("Batch", _about(), COLUMNS, notes=_NOTES)
    exact = _as_numpy(results[f"{alone}, float64"])
    for name, timing in timings.items():
        found = _as_numpy(results[name])
        gaps = [rms(mine.astype(np.float64) - other) for mine, other in zip(found, exact, strict=True)]
        speed = f"{ACTUATORS / timing.median:.0f}"
        cells = (
            seconds(timing.first),
            seconds(timing.median),
            speed,
            times(timing.ratio(timings[f"{spread}, float64"])),
        )
        section.add(name, *cells, f"{gaps[0] * 1e6:.3f}", f"{gaps[1]:.2f}")
    return section


_NOTES = [
    "RMS differences are to float64 on one device, over the whole population; of numba they include its RK4 and its "
    "hard switching.",
]


def _about() -> str:
    held = ", ".join(f"{name} {deviation:.0%}" for name, deviation in SPREAD.items())
    return (
        f"{ACTUATORS} actuators through {SECONDS:g} s at 1 kHz each, 20,000 steps per trace, position and pressure "
        f"kept at every sample; normal spread of {held}; {ROUNDS} rounds."
    )


def _population() -> PyTree[Array]:
    """The printed actuator with every leaf repeated along a leading axis and some of them spread."""
    random = np.random.default_rng(0)
    model = vgtjax.Actuator()
    repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (ACTUATORS, *leaf.shape)), model)
    scattered = {
        name: np.asarray(vgtjax.get_parameter(model, name)) * (1 + deviation * random.standard_normal(ACTUATORS))
        for name, deviation in SPREAD.items()
    }
    return vgtjax.replace_parameters(repeated, scattered)


def _compile(trace: vgtjax.Trace) -> Callable[[PyTree[Array]], tuple[Array, Array]]:
    def one(model):
        solution = vgtjax.simulate(model, trace, throw=False)
        return solution.x_d, solution.p_act

    return jax.jit(jax.vmap(one))


def _as_numpy(found: Any) -> list[np.ndarray]:
    return [np.asarray(values) for values in found]
