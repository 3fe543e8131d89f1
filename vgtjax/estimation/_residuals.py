"""Weighted residuals of a model against measured traces, with sensor offsets eliminated."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._lanes import replicate
from .._types import Vector
from ..parameters import Selection, Transform
from ..plants import AbstractModel
from ..simulation import FixedStep
from ..traces import Trace, noise_level
from ._bundle import CHANNELS, Bundle, bundle_traces
from ._sensitivities import observe, observe_with_jacobian

Weights = Float[Array | np.ndarray, "lanes sample channel"]


class Measured(eqx.Module):
    """Measurements of one bundle in its layout.

    `values` in m and Pa; `weights` is one over the noise, zero on padding and where a channel has no valid sample;
    `owner` is the number of the trace that a lane belongs to.
    """

    values: Weights
    weights: Weights
    owner: Int[Array | np.ndarray, " lanes"]
    traces: int = eqx.field(static=True)


def _measure(bundle: Bundle, traces: Sequence[Trace], channels: Sequence[str]) -> Measured:
    values, weights = [], []
    for channel in CHANNELS:
        filled = [
            _fill(traces[index] if channel in channels else None, channel, count)
            for index, count in zip(bundle.indices, bundle.samples, strict=True)
        ]
        values.append(bundle.to_lanes([value for value, _ in filled]))
        weights.append(bundle.to_lanes([weight for _, weight in filled]))
    return Measured(np.stack(values, -1), np.stack(weights, -1), bundle.lane_trace, traces=len(bundle.indices))


def _fill(trace: Trace | None, channel: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A channel at the times at which its trace is simulated, and its weights: zero where it was not sampled."""
    values, weights = np.zeros((2, count))
    sampled = None if trace is None else trace.sampled(channel)
    if trace is not None and sampled is not None:
        rows = trace.rows(channel)
        values[rows], weights[rows] = sampled.value, 1 / noise_level(sampled.value, channel)
    return values, weights


def _offsets(measured: Measured, difference: Array) -> Float[Array, "traces channel ..."]:
    """Mean difference of each trace and channel: the offset that a least-squares fit would give its sensor."""
    present = jnp.where(measured.weights > 0, 1.0, 0.0)

    def by_trace(values):
        return jax.ops.segment_sum(values.sum(1), measured.owner, measured.traces)

    counts = by_trace(present)
    extra = (1,) * (difference.ndim - 3)
    sums = by_trace(difference * present.reshape(*present.shape, *extra))
    return sums / jnp.maximum(counts, 1.0).reshape(*counts.shape, *extra)


def _whiten(measured: Measured, difference: Array) -> Array:
    """Differences without their offsets, in units of the noise."""
    centred = difference - _offsets(measured, difference)[measured.owner][:, None]
    extra = (1,) * (difference.ndim - 3)
    return centred * measured.weights.reshape(*measured.weights.shape, *extra)


@eqx.filter_jit
def _residual_block(measured: Measured, observed: Array) -> Float[Array, " residuals"]:
    # A simulation that failed is infinitely wrong on every sample, so no optimiser can take it for a fit.
    block = _whiten(measured, observed - measured.values).reshape(-1)
    return jnp.where(jnp.all(jnp.isfinite(observed)), block, jnp.inf)


@eqx.filter_jit
def _jacobian_block(measured: Measured, columns: Array) -> Float[Array, "residuals parameters"]:
    return _whiten(measured, columns).reshape(-1, columns.shape[-1])


class FitProblem(eqx.Module):
    """A least-squares problem: a model, its free parameters, and measured traces.

    Residuals are in units of the sensor noise and divided by the square root of their number, so the cost `sum(r^2)/2`
    of a perfect model is one half. A constant offset of each trace and channel is eliminated exactly.
    """

    model: AbstractModel
    selection: Selection
    transform: Transform
    bundles: list[Bundle]
    measured: list[Measured]
    count: int = eqx.field(static=True)
    """Number of measurements."""
    offsets: int = eqx.field(static=True)
    """Number of eliminated sensor offsets."""

    def at(self, coordinates: Vector) -> Any:
        """The model at coordinates of the transform."""
        return self.selection.unpack(self.model, self.transform.to_physical(coordinates))

    def residuals(self, coordinates: Vector) -> Float[Array, " residuals"]:
        """Residuals; infinite throughout where a simulation failed.

        Its derivative is the exact segment-parallel Jacobian, not the one of the march itself.
        """
        return _residuals(coordinates, self)

    def residuals_and_jacobian(
        self, coordinates: Vector
    ) -> tuple[Float[Array, " residuals"], Float[Array, "residuals parameters"]]:
        """Residuals and their derivatives with respect to the coordinates; zero for a parameter on a bound that a step
        would push through it."""
        model = self.at(coordinates)
        slope = jax.jvp(self.transform.to_physical, (coordinates,), (jnp.ones_like(coordinates),))[1]
        blocks, columns = [], []
        for bundle, measured in zip(self.bundles, self.measured, strict=True):
            observed, derivatives = observe_with_jacobian(model, self.selection, bundle)
            blocks.append(_residual_block(measured, observed))
            columns.append(_jacobian_block(measured, derivatives))
        scale = 1 / np.sqrt(self.count)
        residuals, jacobian = jnp.concatenate(blocks) * scale, jnp.concatenate(columns) * (scale * slope)[None, :]
        held = self.transform.pinned(coordinates, residuals @ jacobian)
        return replicate((residuals, jnp.where(held[None, :], 0.0, jacobian)))


@eqx.filter_custom_jvp
def _residuals(coordinates: Vector, problem: FitProblem) -> Array:
    model = problem.at(coordinates)
    blocks = [
        _residual_block(measured, observe(model, bundle))
        for bundle, measured in zip(problem.bundles, problem.measured, strict=True)
    ]
    return jnp.concatenate(blocks) / np.sqrt(problem.count)


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
    stepping: FixedStep | None = None,
) -> FitProblem:
    """The problem of fitting the selected parameters of `model` to `traces`.

    **Arguments:** `channels`: the measured signals to fit; those that a trace lacks are skipped.
    """
    bundles = bundle_traces(model, traces, stepping)
    measured = [_measure(bundle, traces, channels) for bundle in bundles]
    present = [trace.sampled(channel) is not None for trace in traces for channel in CHANNELS if channel in channels]
    count = sum(int(np.count_nonzero(block.weights)) for block in measured)
    return FitProblem(model, selection, transform, bundles, measured, count, sum(present))
