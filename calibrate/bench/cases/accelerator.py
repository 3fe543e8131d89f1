"""What a GPU or a TPU is for, in one go: each figure beside the CPU's, and checked against its results."""

import math
import os
import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from scipy.stats import qmc

import vgtjax
from vgtjax import InputError

from ..data import example_traces, lengthened, reference
from ..table import Section, seconds, times
from ..timing import interleave
from ..workloads import HELD

ROUNDS = 3
LANES = (1 << 10, 1 << 14, 1 << 17)
"""Powers of two, which most numbers of cores divide."""
SECONDS = 2.0
"""s that every actuator of a batch is simulated for."""
VARIED = ("diaphragm.stiffness", "friction.coulomb_force")
COLUMNS = ("work", "accelerator", "CPU", "CPU / accelerator", "largest difference")
Found = dict[str, tuple[float, np.ndarray]]
"""By workload: median seconds, and the result."""


def measure() -> Section:
    """Times all workloads on the accelerator and on the CPU of the same machine.

    **Raises:** `InputError` where JAX sees no accelerator.
    """
    if jax.default_backend() == "cpu":
        raise InputError(
            "this benchmark needs a GPU or a TPU, but JAX sees only a CPU; install JAX for it, for instance "
            "pip install 'jax[cuda12]'"
        )
    return compare(LANES)


def compare(lanes: Sequence[int]) -> Section:
    """The table for batches of these sizes, on whatever JAX computes by default."""
    section = Section("Accelerator", _about(), COLUMNS)
    here, there = _run(lanes), _run_on_cpu(lanes)
    for name, (spent, found) in here.items():
        alone, exact = there[name]
        gap = float(np.max(np.abs(found - exact)) / np.max(np.abs(exact)))
        section.add(name, seconds(spent), seconds(alone), times(alone / spent), f"{gap:.1e}")
    return section


def _about() -> str:
    devices = jax.devices()
    return (
        f"{len(devices)} x {devices[0].device_kind} beside the CPU of the same machine (lanes over its "
        f"{os.cpu_count()} cores, a process with JAX_PLATFORMS=cpu), medians of {ROUNDS} rounds after a first. "
        "Stiffness and Coulomb force of the lanes are Halton's points within 10 %, the same everywhere; of each the "
        "last position is kept. Differences are relative to the largest value of the CPU's in the same precision."
    )


def _workloads(lanes: Sequence[int]) -> dict[str, Callable[[], Any]]:
    """Batches in both precisions, and the exact Jacobian of the example."""
    model, traces = vgtjax.Actuator(), example_traces()
    work: dict[str, Callable[[], Any]] = {}
    for dtype in (np.float32, np.float64):
        run = jax.jit(jax.vmap(partial(_last_position, jax.tree.map(lambda leaf, to=dtype: leaf.astype(to), model))))
        for count in lanes:
            factors = 0.9 + 0.2 * qmc.Halton(len(VARIED), scramble=False).random(count)
            name = f"{count} actuators, {SECONDS:g} s, {np.dtype(dtype).name}"
            work[name] = partial(run, _spread(factors.astype(dtype)))
    work["jacobian of the example, float64"] = lambda: vgtjax.jacobian(model, traces, fixed=HELD)
    return work


def _spread(factors: np.ndarray) -> jax.Array:
    """Lanes over as many devices as divide their number: a CPU has one a core."""
    devices = np.asarray(jax.devices()[: math.gcd(len(factors), jax.device_count())])
    return jax.device_put(factors, NamedSharding(Mesh(devices, ("lane",)), PartitionSpec("lane")))


def _last_position(model: vgtjax.Actuator, factors: jax.Array) -> jax.Array:
    moved = {name: vgtjax.get_parameter(model, name) * factors[i] for i, name in enumerate(VARIED)}
    trace = lengthened(reference("levels").trace, SECONDS)
    return vgtjax.simulate(vgtjax.replace_parameters(model, moved), trace, throw=False).x_d[-1]


def _run(lanes: Sequence[int]) -> Found:
    found = {}
    for name, work in _workloads(lanes).items():
        timings, results = interleave({name: work}, ROUNDS)
        flat = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(results[name])])
        found[name] = (timings[name].median, flat.astype(np.float64))
    return found


def _run_on_cpu(lanes: Sequence[int]) -> Found:
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "cpu.npz"
        serve_there = f"import sys; from {__name__} import serve; serve(*sys.argv[1:])"
        command = [sys.executable, "-c", serve_there, str(file), *map(str, lanes)]
        subprocess.run(command, env={**os.environ, "JAX_PLATFORMS": "cpu"}, check=True)
        with np.load(file) as stored:
            names, spent, *results = (stored[name] for name in stored.files)
    return {str(name): (float(each), result) for name, each, result in zip(names, spent, results, strict=True)}


def serve(file: str, *lanes: str) -> None:
    """Computes all in this process, and writes what the other one reads."""
    vgtjax.configure()
    found = _run([int(count) for count in lanes])
    spent, results = zip(*found.values(), strict=True)
    np.savez(file, np.array(list(found)), np.array(spent), *results)
