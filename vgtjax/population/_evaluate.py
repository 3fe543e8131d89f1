"""Experiments on many actuators at once: lanes of one compiled function, spread over all devices."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._devices import bring_home, share_out
from .._errors import InputError
from ..experiments import AbstractExperiment, Output, stack_runs
from ..plants import AbstractModel
from ..simulation import FixedMarch, FixedStep, march
from ..traces import Drive, Start, cast, require
from ._factors import Factors

LANES = 1024
"""Actuators a chunk: enough for wide vectors on every core, and some 100 MB of signals."""


@dataclasses.dataclass(frozen=True, eq=False)
class Results:
    """What the experiments read off some actuators.

    `outputs` in SI units, NaN where a response does not have an output; `failed` marks simulations that left the
    finite numbers, all of whose outputs are NaN.
    """

    outputs: Float[np.ndarray, "rows columns"]
    failed: Bool[np.ndarray, " rows"]

    def only(self, columns: Sequence[int]) -> "Results":
        """The same rows with some of the columns."""
        return Results(self.outputs[:, list(columns)], self.failed)


class _Bench(eqx.Module):
    """One experiment with its inputs."""

    experiment: AbstractExperiment
    drive: Drive
    start: Start
    plan: FixedMarch


class Evaluator:
    """Runs experiments on actuators that differ in some parameters.

    Compiled once for a number of lanes; every actuator is computed by itself, so that one whose simulation fails
    touches no other. With several processes every one of them must make the same calls, and gets the same results.
    """

    def __init__(
        self,
        model: AbstractModel,
        factors: Factors,
        experiments: Sequence[AbstractExperiment],
        *,
        lanes: int = LANES,
        stepping: FixedStep | None = None,
        dtype: Any = np.float64,
    ):
        """Prepares a run.

        **Arguments:**

        - `model`, `factors`: the actuator, and the entries whose values vary.
        - `lanes`: rows a chunk, rounded up to a multiple of the devices.
        - `stepping`: as in [`simulate`][].
        - `dtype`: `float32` takes a third of the time; README says what it costs in accuracy.

        **Raises:** `InputError` for no experiment, fewer than one lane, or a model that the experiments can't drive.
        """
        if not experiments or lanes < 1:
            raise InputError(
                f"an evaluation needs an experiment and a lane, but there are {len(experiments)} and {lanes}; give both"
            )
        stepping = FixedStep() if stepping is None else stepping
        devices = jax.device_count()
        self.lanes = devices * math.ceil(lanes / devices)
        self.outputs: tuple[Output, ...] = tuple(output for each in experiments for output in each.outputs)
        self._dtype = np.dtype(dtype)
        # NumPy leaves belong to no device, so they fit any number of processes.
        self._model = jax.tree.map(lambda leaf: np.asarray(leaf, self._dtype), model)
        self._factors = factors
        self._benches = tuple(self._prepare(model, experiment, stepping) for experiment in experiments)

    def _prepare(self, model: AbstractModel, experiment: AbstractExperiment, stepping: FixedStep) -> _Bench:
        for trace in experiment.traces:
            require(trace, model.needs)
        drive, start = cast(stack_runs(experiment.traces), self._dtype)
        fixed = jax.tree.map(lambda leaf: np.asarray(leaf, self._dtype), experiment)
        return _Bench(fixed, drive, start, stepping.plan_intervals(model, experiment.traces[0].longest_interval))

    @functools.cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of results: outputs, with a number for every point of a curve."""
        names: list[str] = []
        for output in self.outputs:
            names += [f"{output.name}[{i}]" for i in range(output.size)] if output.axis else [output.name]
        return tuple(names)

    def __call__(self, values: Float[np.ndarray, "rows parameters"]) -> Results:
        """Results of every row of parameter values, in the units of the table."""
        parts = [self._chunk(values[begin : begin + self.lanes]) for begin in range(0, len(values), self.lanes)]
        return Results(
            np.concatenate([part.outputs for part in parts]), np.concatenate([part.failed for part in parts])
        )

    def _chunk(self, values: np.ndarray) -> Results:
        found, finite = bring_home(
            _evaluate(self._model, self._factors, self._benches, self._lay_out(values, self.lanes))
        )
        failed = ~np.asarray(finite)[: len(values)]
        outputs = np.asarray(found, np.float64)[: len(values)]
        return Results(np.where(failed[:, None], np.nan, outputs), failed)

    def gradient(self, values: Float[np.ndarray, "rows parameters"]) -> Float[np.ndarray, "rows columns parameters"]:
        """Exact derivatives of every column by every parameter, at every row; NaN where the column is NaN."""
        rows, size = values.shape
        points, directions = np.repeat(values, size, axis=0), np.tile(np.eye(size), (rows, 1))
        devices = jax.device_count()
        lanes = min(self.lanes, devices * math.ceil(rows * size / devices))
        parts = []
        for begin in range(0, rows * size, lanes):
            here = slice(begin, begin + lanes)
            slopes = _slopes(
                self._model,
                self._factors,
                self._benches,
                self._lay_out(points[here], lanes),
                self._lay_out(directions[here], lanes),
            )
            parts.append(np.asarray(bring_home(slopes), np.float64)[: len(points[here])])
        return np.concatenate(parts).reshape(rows, size, -1).swapaxes(1, 2)

    def _lay_out(self, rows: np.ndarray, lanes: int) -> Array:
        """Rows on their devices, the last one repeated to fill the lanes."""
        padded = np.concatenate([rows, np.repeat(rows[-1:], lanes - len(rows), axis=0)])
        return share_out(np.ascontiguousarray(padded, self._dtype))


@eqx.filter_jit
def _evaluate(
    model: AbstractModel, factors: Factors, benches: tuple[_Bench, ...], values: Array
) -> tuple[Float[Array, "lanes columns"], Bool[Array, " lanes"]]:
    return jax.vmap(lambda row: _run(factors.unpack(model, row), benches))(values)


@eqx.filter_jit
def _slopes(
    model: AbstractModel,
    factors: Factors,
    benches: tuple[_Bench, ...],
    values: Array,
    directions: Array,
) -> Float[Array, "lanes columns"]:
    def columns(row: Array) -> Array:
        found, finite = _run(factors.unpack(model, row), benches)
        return jnp.where(finite, found, jnp.nan)

    def slope(row: Array, direction: Array) -> Array:
        found, along = jax.jvp(columns, (row,), (direction,))
        # A NaN that is put in is a constant to the derivative, which would be zero.
        return jnp.where(jnp.isnan(found), jnp.nan, along)

    return jax.vmap(slope)(values, directions)


def _run(model: AbstractModel, benches: tuple[_Bench, ...]) -> tuple[Array, Array]:
    """All readings of one actuator as one vector, and whether its simulations stayed finite."""
    columns, finite = [], jnp.asarray(True)
    for bench in benches:
        x_d, p_act = jax.lax.map(lambda run, bench=bench: _observe(model, run, bench), (bench.drive, bench.start))
        readings = bench.experiment.read(x_d, p_act, model.air.pressure)
        columns += [jnp.reshape(readings[output.name], (-1,)) for output in bench.experiment.outputs]
        finite &= jnp.all(jnp.isfinite(x_d)) & jnp.all(jnp.isfinite(p_act))
    return jnp.concatenate(columns), finite


def _observe(model: AbstractModel, run: tuple[Drive, Start], bench: _Bench) -> tuple[Array, Array]:
    drive, start = run
    states, _ = march(model, drive, start, bench.plan)
    return jax.vmap(model.observe)(states, drive)
