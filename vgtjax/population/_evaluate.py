"""Experiments on many actuators at once: lanes of one compiled function, spread over all devices."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from .._errors import InputError
from .._lanes import fill_devices, map_rows
from ..experiments import AbstractExperiment, Output, stack_runs
from ..plants import AbstractModel, tabulated_along
from ..simulation import RESULTS, AbstractFixedStepping, FixedMarch, FixedStep, fixed, march
from ..traces import Drive, Start, cast, require
from ._factors import Factors
from ._population import Population
from ._results import Gradients, Results
from ._sampling import make_sample

LANES = 1024
"""Actuators per chunk: enough for wide vectors on every core, and some 100 MB of signals."""


class _Prepared(eqx.Module):
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
        dtype: DTypeLike = np.float64,
    ):
        """Prepares a run.

        **Arguments:**

        - `model`, `factors`: the actuator, and the entries whose values vary.
        - `lanes`: rows a chunk, rounded up to a multiple of the devices.
        - `stepping`: as in [`simulate`][].
        - `dtype`: `float32` takes a third of the time; the manual says what it costs in accuracy.

        **Raises:** `InputError` for no experiment, fewer than one lane, or a model that the experiments can't drive.
        """
        if not experiments or lanes < 1:
            raise InputError(
                f"an evaluation needs an experiment and a lane, but there are {len(experiments)} and {lanes}; give both"
            )
        self.lanes = fill_devices(lanes)
        self.outputs: tuple[Output, ...] = tuple(output for each in experiments for output in each.outputs)
        self._dtype = np.dtype(dtype)
        # NumPy leaves belong to no device, so they fit any number of processes.
        self._model = jax.tree.map(lambda leaf: np.asarray(leaf, self._dtype), model)
        self._factors = factors
        self._prepared = tuple(self._prepare(model, experiment, fixed(stepping)) for experiment in experiments)

    def _prepare(
        self, model: AbstractModel, experiment: AbstractExperiment, stepping: AbstractFixedStepping
    ) -> _Prepared:
        for trace in experiment.traces:
            require(trace, model.needs)
        drive, start = cast(stack_runs(experiment.traces), self._dtype)
        ready = jax.tree.map(lambda leaf: np.asarray(leaf, self._dtype), experiment)
        return _Prepared(ready, drive, start, stepping.plan_intervals(model, experiment.traces[0].longest_interval))

    def __call__(self, values: Float[np.ndarray, "rows factors"]) -> Results:
        """Results of every row of values, in the units of the table."""
        matrix, result = self._map(_evaluate, (values,), self.lanes)
        return Results(self.outputs, matrix.astype(float), result)

    def gradient(self, values: Float[np.ndarray, "rows factors"]) -> Gradients:
        """Exact derivatives of every output with respect to every factor, at every row.

        NaN where the output is NaN.
        """
        rows, size = values.shape
        points, directions = np.repeat(values, size, axis=0), np.tile(np.eye(size), (rows, 1))
        slopes, ends = self._map(_slopes, (points, directions), min(self.lanes, rows * size))
        result = jax.tree.map(lambda leaf: leaf[::size], ends)  # that of a row in every direction
        return Gradients(self.outputs, slopes.astype(float).reshape(rows, size, -1).swapaxes(1, 2), result)

    def _map(self, function: Callable[..., Any], rows: tuple[np.ndarray, ...], lanes: int) -> Any:
        def at(places: np.ndarray) -> tuple[np.ndarray, ...]:
            return tuple(np.ascontiguousarray(each[places], self._dtype) for each in rows)

        def run(shared: tuple[Array, ...]) -> Any:
            return function(self._model, self._factors, self._prepared, *shared)

        return map_rows(run, at, len(rows[0]), lanes)


@eqx.filter_jit
def _evaluate(
    model: AbstractModel, factors: Factors, prepared: tuple[_Prepared, ...], values: Array
) -> tuple[Float[Array, "lanes columns"], RESULTS]:
    return jax.vmap(lambda row: _run(factors.unpack(model, row), prepared))(values)


@eqx.filter_jit
def _slopes(
    model: AbstractModel, factors: Factors, prepared: tuple[_Prepared, ...], values: Array, directions: Array
) -> tuple[Float[Array, "lanes columns"], RESULTS]:
    def slope(row: Array, direction: Array) -> tuple[Array, RESULTS]:
        run = functools.partial(_run, prepared=prepared)
        found, along, status = jax.jvp(lambda row: run(factors.unpack(model, row)), (row,), (direction,), has_aux=True)
        # A NaN that is put in is a constant to the derivative, which would be zero.
        return jnp.where(jnp.isnan(found), jnp.nan, along), status

    return jax.vmap(slope)(values, directions)


def _run(model: AbstractModel, prepared: tuple[_Prepared, ...]) -> tuple[Array, RESULTS]:
    """All readings of one actuator as one vector, NaN if a simulation failed, and how the first that failed ended."""
    columns: list[Array] = []
    status: Any = RESULTS.successful
    # Tables are made once, not in every run.
    model = tabulated_along(model, *(each.drive for each in prepared))
    for each in prepared:
        x_d, p_act, ends = jax.lax.map(lambda run, each=each: _observe(model, run, each), (each.drive, each.start))
        readings = each.experiment.read(x_d, p_act, model.air.pressure)
        columns += [jnp.reshape(readings[output.name], (-1,)) for output in each.experiment.outputs]
        for number in range(len(x_d)):
            end = jax.tree.map(lambda leaf, number=number: leaf[number], ends)
            status = RESULTS.where(status == RESULTS.successful, end, status)
    return jnp.where(status == RESULTS.successful, jnp.concatenate(columns), jnp.nan), status


def _observe(model: AbstractModel, run: tuple[Drive, Start], each: _Prepared) -> tuple[Array, Array, RESULTS]:
    drive, start = run
    states, result = march(model, drive, start, each.plan)
    return *jax.vmap(model.observe)(states, drive), result


def run(
    population: Population,
    experiments: Sequence[AbstractExperiment],
    samples: int = 1024,
    *,
    sampler: str = "sobol",
    seed: int = 0,
    lanes: int = LANES,
    stepping: FixedStep | None = None,
    dtype: DTypeLike = np.float64,
) -> Results:
    """Monte Carlo: what the experiments read off actuators drawn from a population.

        population = vgtjax.population.spread_population(vgtjax.Actuator(), relative=0.02)
        results = vgtjax.population.run(population, [vgtjax.experiments.SlowLoop()], samples=256)
        results["hysteresis_0mbar"]  # (256,), Pa

    The same samples as those of the command `tolerance`, on any number of devices.

    **Arguments:**

    - `samples`, `sampler`, `seed`: as in [`make_sample`][vgtjax.population.make_sample]; powers of two are best.
    - `lanes`, `stepping`, `dtype`: as in [`Evaluator`][vgtjax.population.Evaluator].

    **Raises:** `InputError` for a sample or an experiment that can't be.
    """
    sample = make_sample(population.dimensions, samples, sampler, seed)
    lanes = min(lanes, samples)
    evaluator = Evaluator(
        population.model, population.factors, experiments, lanes=lanes, stepping=stepping, dtype=dtype
    )
    return evaluator(population.values(sample.points(0, samples)))
