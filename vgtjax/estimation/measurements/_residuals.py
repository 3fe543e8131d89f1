"""Weighted residuals of a model against measured traces, with sensor offsets eliminated."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._kept import keep_compiled
from ..._types import Scalar, Vector
from ...parameters import Selection, Transform
from ...plants import AbstractModel
from ...simulation import RESULTS, AbstractStepping
from ...traces import Trace
from ..derivatives import (
    CHANNELS,
    SEGMENT,
    Bundle,
    Evaluated,
    Evaluation,
    bundle_traces,
    observe,
    observe_with_jacobian,
)
from ._edge_times import Edges, covariance_root, from_mean
from ._measured import (
    Measured,
    SensorsOfTraces,
    count_of,
    jacobian_block,
    knowing_edges,
    measure,
    pull_block,
    residual_block,
    white_sensors,
)


class Prior(eqx.Module):
    """What is known of coordinates beforehand: `center`, and one over its standard deviation, zero for nothing."""

    center: Float[np.ndarray, " coordinates"]
    precision: Float[np.ndarray, " coordinates"]

    def residuals(self, coordinates: Vector) -> Float[Array | np.ndarray, " coordinates"]:
        """Distances from the centers in standard deviations."""
        return self.precision * (coordinates - self.center)


class FitProblem(eqx.Module):
    """A least-squares problem: a model, its free parameters, and measured traces.

    Residuals are in units of the sensor noise and divided by the square root of their number, so the cost `sum(r^2)/2`
    of a perfect model is one half. A constant offset of each trace and channel is eliminated exactly.

    With `late_duty` the last coordinate is the delay of the duty, behind those of the selection. `edges` are those of
    the duty where their times are not known.
    """

    model: AbstractModel
    selection: Selection
    transform: Transform
    bundles: list[Bundle]
    measured: list[Measured]
    count: int = eqx.field(static=True)
    """Number of measurements."""
    offsets: int = eqx.field(static=True)
    """Number of eliminated sensor offsets, and of edges of the duty."""
    late_duty: bool = eqx.field(static=True, default=False)
    prior: Prior | None = None
    edges: Edges | None = None

    def at(self, coordinates: Vector) -> tuple[Any, Scalar | None]:
        """The model at coordinates of the transform, and the delay of the duty in s if that is one of them."""
        return _at(self.model, self.selection, self.transform, self.late_duty, coordinates)

    def evaluation(self, coordinates: Float[np.ndarray, " coordinates"], *, slopes: bool = False) -> Evaluation:
        """The question what the sensors would see at coordinates, and how that changes with them."""
        model, delay = self.at(coordinates)
        late = float(delay) if delay is not None and self.delay_is_free else None
        return Evaluation(model, self.bundles, late, self.selection if slopes else None)

    @property
    def delay_is_free(self) -> bool:
        """Whether the duty may be late where it is simulated; if it may not, no step is spent on a jump in between."""
        return self.late_duty and bool(self.transform.lower[-1] < self.transform.upper[-1])

    def with_held_delay(self, columns: Float[np.ndarray, "... columns"]) -> Float[np.ndarray, "... coordinates"]:
        """Derivatives with respect to all coordinates, zero for a delay that is not free and was not asked for."""
        if self.delay_is_free or not self.late_duty:
            return columns
        return np.concatenate([columns, np.zeros((*columns.shape[:-1], 1))], axis=-1)

    @property
    def placed_edges(self) -> Edges | None:
        """Edges whose traces stay where they were placed when the delay of the duty moves."""
        return self.edges if self.late_duty else None

    def beside_edges(self, evaluated: Evaluated, coordinates: Float[np.ndarray, " coordinates"]) -> Evaluated:
        """What was answered for coordinates, with what a delay of the duty moves of traces whose edges are placed."""
        edges, (_, delay) = self.placed_edges, self.at(coordinates)
        if edges is None or delay is None:
            return evaluated
        observed = [np.asarray(each) for each in edges.moved(evaluated.observed, delay)]
        columns = edges.moving(evaluated.columns) if evaluated.columns else []
        return Evaluated(observed, [np.asarray(each) for each in columns], evaluated.ended)

    def pulled_edges(self, cotangent: Sequence[np.ndarray], count: int) -> Float[np.ndarray, " coordinates"]:
        """The same of an answer in reverse mode: what it adds to so many derivatives."""
        edges, more = self.placed_edges, np.zeros(count)
        more[-1] = 0.0 if edges is None else edges.pulled(cotangent)
        return more

    def residuals_of(self, observed: Sequence[np.ndarray]) -> Float[np.ndarray, " residuals"]:
        """Residuals in units of the noise, of what was observed of every bundle."""
        blocks = [residual_block(*block) for block in zip(self.measured, map(jnp.asarray, observed), strict=True)]
        return self._owned(blocks)

    def everything_of(
        self, observed: Sequence[np.ndarray], coordinates: Float[np.ndarray, " coordinates"]
    ) -> Float[np.ndarray, " residuals"]:
        """`residuals_of`, and behind them the distances from what is known of the coordinates beforehand."""
        found = self.residuals_of(observed)
        return found if self.prior is None else np.concatenate([found, np.asarray(self.prior.residuals(coordinates))])

    def columns_of(
        self, columns: Sequence[np.ndarray], at: Float[np.ndarray, " coordinates"]
    ) -> Float[np.ndarray, "residuals coordinates"]:
        """Derivatives of `residuals_of` with respect to the coordinates, from those of what is observed at `at`."""
        found = self.whitened(columns)
        with np.errstate(over="ignore", invalid="ignore"):  # derivatives that have exploded
            found *= np.asarray(self.transform.slope(at))
        return found

    def whitened(self, columns: Sequence[np.ndarray]) -> Float[np.ndarray, "residuals columns"]:
        """Derivatives of `residuals_of`, from those of what is observed, with respect to the same quantities."""
        blocks = [jacobian_block(*block) for block in zip(self.measured, map(jnp.asarray, columns), strict=True)]
        return self._owned(blocks)

    def _owned(self, blocks: Sequence[Array]) -> np.ndarray:
        """Rows of lanes that belong to a trace."""
        return np.concatenate(
            [np.asarray(block)[: bundle.rows] for bundle, block in zip(self.bundles, blocks, strict=True)]
        )

    def pulled(
        self, cotangent: Float[np.ndarray, " residuals"], observed: Sequence[np.ndarray]
    ) -> list[Float[np.ndarray, "lanes sample channel"]]:
        """A cotangent of `residuals_of` what was observed as one of that, bundle by bundle."""
        ends = np.cumsum([bundle.rows for bundle in self.bundles])[:-1]
        parts = [
            np.pad(part, (0, seen.size - len(part)))
            for part, seen in zip(np.split(cotangent, ends), observed, strict=True)
        ]
        pairs = zip(self.measured, observed, parts, strict=True)
        return [np.asarray(pull_block(known, jnp.asarray(seen), jnp.asarray(part))) for known, seen, part in pairs]

    @property
    def owner(self) -> Int[np.ndarray, " residuals"]:
        """The number of the trace of every residual."""
        owners = [np.asarray(bundle.indices)[bundle.lane_trace[: bundle.owned]] for bundle in self.bundles]
        return np.repeat(np.concatenate(owners), SEGMENT * len(CHANNELS))

    def with_sensors(self, traces: Sequence[Trace], sensors: SensorsOfTraces) -> "FitProblem":
        """The same problem with other knowledge of the sensors."""
        measured = [measure(bundle, traces, sensors) for bundle in self.bundles]
        again = dataclasses.replace(self, measured=measured, count=count_of(sensors))
        return again if self.edges is None else again._knowing(self.edges)

    def with_edges(self, edges: Edges) -> "FitProblem":
        """The same problem where the times of edges are not known."""
        return dataclasses.replace(self._knowing(edges), offsets=self.offsets + sum(map(len, edges.late)))

    def _knowing(self, edges: Edges) -> "FitProblem":
        root, later = covariance_root(edges.most, delay=edges.delay), from_mean(edges.late)
        measured = [
            knowing_edges(block, responses, root, later[list(bundle.indices)])
            for block, bundle, responses in zip(
                self.without_edges().measured, self.bundles, edges.responses, strict=True
            )
        ]
        return dataclasses.replace(self, measured=measured, edges=edges)

    def without_edges(self) -> "FitProblem":
        """The same problem where edges are at the times that are read."""
        measured = [dataclasses.replace(each, edges=None, expected=None) for each in self.measured]
        return dataclasses.replace(self, measured=measured)

    def residuals(self, coordinates: Vector) -> Float[Array, " residuals"]:
        """Residuals; infinite throughout where a simulation failed.

        Its derivative is the exact segment-parallel Jacobian, not the one of the march itself.
        """
        found = _residuals(coordinates, self)
        if self.prior is None:
            return found
        return jnp.concatenate([found, self.prior.residuals(coordinates) / np.sqrt(self.count)])

    def residuals_and_jacobian(
        self, coordinates: Vector
    ) -> tuple[Float[Array, " residuals"], Float[Array, "residuals parameters"]]:
        """Residuals and their derivatives with respect to the coordinates; zero for a parameter on a bound that a step
        would push through it."""
        model, delay = self.at(coordinates)
        slope = jax.jvp(self.transform.to_physical, (coordinates,), (jnp.ones_like(coordinates),))[1]
        found = [observe_with_jacobian(model, self.selection, bundle, delay) for bundle in self.bundles]
        observed, derivatives = [seen for seen, _, _ in found], [columns for _, columns, _ in found]
        if self.placed_edges is not None and delay is not None:
            observed, derivatives = self.placed_edges.moved(observed, delay), self.placed_edges.moving(derivatives)
        blocks = _finite_blocks(self.measured, observed, [ended for _, _, ended in found])
        columns = [jacobian_block(*pair) for pair in zip(self.measured, derivatives, strict=True)]
        scale = 1 / np.sqrt(self.count)
        residuals, jacobian = jnp.concatenate(blocks) * scale, jnp.concatenate(columns) * (scale * slope)[None, :]
        held = self.transform.pinned(coordinates, residuals @ jacobian)
        return residuals, jnp.where(held[None, :], 0.0, jacobian)


@keep_compiled
def _at(
    model: AbstractModel, selection: Selection, transform: Transform, late_duty: bool, coordinates: Vector
) -> tuple[Any, Scalar | None]:
    values = transform.to_physical(coordinates)
    return selection.unpack(model, values[: len(selection.entries)]), values[-1] if late_duty else None


@eqx.filter_custom_jvp
def _residuals(coordinates: Vector, problem: FitProblem) -> Array:
    model, delay = problem.at(coordinates)
    observed, ended = map(list, zip(*(observe(model, bundle, delay) for bundle in problem.bundles), strict=True))
    if problem.placed_edges is not None and delay is not None:
        observed = problem.placed_edges.moved(observed, delay)
    return jnp.concatenate(_finite_blocks(problem.measured, observed, ended)) / np.sqrt(problem.count)


def _finite_blocks(measured: list[Measured], observed: Sequence[Array], ended: Sequence[RESULTS]) -> list[Array]:
    """Residuals of every bundle; infinite where a simulation of it failed."""
    return [
        jnp.where(jnp.all(end == RESULTS.successful), residual_block(known, seen), jnp.inf)
        for known, seen, end in zip(measured, observed, ended, strict=True)
    ]


@_residuals.def_jvp
def _residuals_jvp(primals: Any, tangents: Any) -> tuple[Array, Array]:
    coordinates, problem = primals
    residuals, columns = problem.residuals_and_jacobian(coordinates)
    return residuals, columns @ tangents[0]


def build_fit_problem(
    model: AbstractModel,
    selection: Selection,
    transform: Transform,
    traces: Sequence[Trace],
    *,
    channels: Sequence[str] = CHANNELS,
    sensors: SensorsOfTraces | None = None,
    stepping: AbstractStepping | None = None,
    prior: Prior | None = None,
) -> FitProblem:
    """The problem of fitting the selected parameters of `model` to `traces`.

    **Arguments:**

    - `transform`: of the selected entries; with one coordinate more, that is the delay of the duty in s.
    - `channels`: the measured signals to fit; those that a trace lacks are skipped.
    - `prior`: what is known of the coordinates beforehand.
    - `sensors`: what is known of them; by default white noise of the size that their signals show.
    """
    sensors = white_sensors(traces, channels) if sensors is None else sensors
    bundles = bundle_traces(model, traces, stepping)
    measured = [measure(bundle, traces, sensors) for bundle in bundles]
    offsets = sum(len(each) for each in sensors)
    late_duty = len(transform.scale) > len(selection.entries)
    return FitProblem(
        model,
        selection,
        transform,
        bundles,
        measured,
        count_of(sensors),
        offsets,
        late_duty,
        prior,
    )
