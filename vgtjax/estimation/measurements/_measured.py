"""Measurements in the layout of a bundle, and how residuals are whitened by what is known of sensors and edges."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._kept import keep_compiled
from ...traces import Trace
from ..derivatives import CHANNELS, SEGMENT, Bundle
from ._sensors import MEMORY, SensorNoise, white_sensor

SMALLEST = 1e-300
Weights = Float[Array | np.ndarray, "lanes sample channel"]


class Measured(eqx.Module):
    """Measurements of one bundle in its layout.

    `values` in m and Pa; `weights` is one over the deviation of what is new in a sample, zero on padding and where a
    channel has no valid sample; `owner` is the number of the trace that a lane belongs to. Of noise with a memory,
    `memory[..., i]` is the part of the residual that was `i + 1` valid samples ago, at the flat place `past[..., i]`.
    `edges` are directions, trace by trace, of what is left of edges of the duty whose time is not known, and `expected`
    how much more is observed where these are read than where they are expected.
    """

    values: Weights
    weights: Weights
    owner: Int[Array | np.ndarray, " lanes"]
    memory: Float[Array | np.ndarray, "places channel order"] | None
    past: Int[Array | np.ndarray, "places channel order"] | None
    traces: int = eqx.field(static=True)
    edges: Float[Array | np.ndarray, "lanes sample channel edges"] | None = None
    expected: Weights | None = None


SensorsOfTraces = Sequence[dict[str, SensorNoise]]
"""Sensors of every trace, by channel; those that are not fitted are left out."""


def white_sensors(traces: Sequence[Trace], channels: Sequence[str]) -> SensorsOfTraces:
    """Sensors whose noise is white and of the size that their own signals show."""
    found = [{channel: white_sensor(trace, channel) for channel in channels} for trace in traces]
    return [{channel: sensor for channel, sensor in sensors.items() if sensor is not None} for sensors in found]


def count_of(sensors: SensorsOfTraces) -> int:
    """Samples that say something."""
    return sum(sensor.count for each in sensors for sensor in each.values())


def measure(bundle: Bundle, traces: Sequence[Trace], sensors: SensorsOfTraces) -> Measured:
    order = MEMORY if any(len(sensor.memory) for each in sensors for sensor in each.values()) else 0
    places = SEGMENT * len(bundle.lane_trace)
    values, weights = np.zeros((2, places, len(CHANNELS)))
    memory, past = np.zeros((places, len(CHANNELS), order)), np.zeros((places, len(CHANNELS), order), int)
    for number, index in enumerate(bundle.indices):
        for channel, sensor in sensors[index].items():
            rows, at = SEGMENT * bundle.first_lane(number) + traces[index].rows(channel), CHANNELS.index(channel)
            length = len(sensor.memory)
            values[rows, at] = sensor.values
            weights[rows, at] = sensor.trust / sensor.deviation
            # The first samples have no past: they weigh what the noise itself does.
            weights[rows[:length], at] *= sensor.deviation / sensor.level
            memory[rows[length:], at, :length] = sensor.memory
            for step in range(1, length + 1):
                past[rows[step:], at, step - 1] = rows[:-step]
    shape = (len(bundle.lane_trace), SEGMENT, len(CHANNELS))
    return Measured(
        values.reshape(shape),
        weights.reshape(shape),
        bundle.lane_trace,
        memory if order else None,
        past if order else None,
        bundle.shape.traces,
    )


def whiten(measured: Measured, difference: Float[Array, "lanes sample channel ..."]) -> Array:
    """What is new in differences, in units of its deviation, without the offset that a fit would give each sensor."""
    weights = jnp.asarray(measured.weights)
    # An offset is a column like any other: what it explains is projected out, trace by trace and channel by channel.
    column = weights * _forget(measured, jnp.ones_like(weights))
    extra = (1,) * (difference.ndim - 3)
    weights, column = (each.reshape(*each.shape, *extra) for each in (weights, column))
    new = weights * _forget(measured, difference)
    explained = _by_trace(measured, column * new) / jnp.maximum(_by_trace(measured, column**2), SMALLEST)
    new = new - column * explained[measured.owner][:, None]
    if measured.edges is None:
        return new
    along = jnp.einsum("lscj,lsc...->lj...", measured.edges, new)
    along = jax.ops.segment_sum(along, measured.owner, measured.traces)
    return new - jnp.einsum("lscj,lj...->lsc...", measured.edges, along[measured.owner])


def knowing_edges(
    measured: Measured,
    responses: Float[np.ndarray, "lanes sample channel edges"],
    root: Float[np.ndarray, "edges edges"],
    later: Float[np.ndarray, "traces edges"],
) -> Measured:
    """Measurements of traces whose edges have unknown times, by what is observed when one is a sample later.

    The covariance of what is new in a sample is `1 + E C E^T`, with `E` those responses in units of the deviation and
    `C` the covariance of edges beforehand: residuals are multiplied by the inverse of its root.

    **Arguments:** `root`: of `C`; `later`: samples by which edges are later than expected beforehand.
    """
    columns = np.asarray(jacobian_block(measured, jnp.asarray(responses))) @ root
    owner = np.repeat(np.asarray(measured.owner), SEGMENT * len(CHANNELS))
    directions = np.zeros_like(columns)
    for trace in np.unique(owner):
        basis, sizes, _ = np.linalg.svd(columns[owner == trace], full_matrices=False)
        directions[owner == trace] = basis * np.sqrt(1 - 1 / np.sqrt(1 + sizes**2))
    expected = np.einsum("lscj,lj->lsc", responses, later[np.asarray(measured.owner)])
    return dataclasses.replace(measured, edges=directions.reshape(responses.shape), expected=expected)


def _by_trace(measured: Measured, values: Array) -> Float[Array, "traces channel ..."]:
    return jax.ops.segment_sum(values.sum(1), measured.owner, measured.traces)


def _forget(measured: Measured, difference: Float[Array, "lanes sample channel ..."]) -> Array:
    """Differences without the part that those before them tell."""
    if measured.memory is None or measured.past is None:
        return difference
    flat = difference.reshape(-1, *difference.shape[2:])
    extra = (1,) * (flat.ndim - 2)
    new = flat
    for step in range(measured.memory.shape[-1]):
        past = measured.past[..., step].reshape(*measured.past.shape[:2], *extra)
        part = measured.memory[..., step].reshape(*measured.memory.shape[:2], *extra)
        new = new - part * jnp.take_along_axis(flat, past, axis=0)
    return new.reshape(difference.shape)


@keep_compiled
def residual_block(measured: Measured, observed: Array) -> Float[Array, " residuals"]:
    # A simulation that failed is infinitely wrong on every sample, so no optimiser can take it for a fit.
    difference = observed - measured.values
    if measured.expected is not None:
        difference = difference - measured.expected
    block = whiten(measured, difference).reshape(-1)
    return jnp.where(jnp.all(jnp.isfinite(observed)), block, jnp.inf)


@keep_compiled
def jacobian_block(measured: Measured, columns: Array) -> Float[Array, "residuals parameters"]:
    return whiten(measured, columns).reshape(-1, columns.shape[-1])


@keep_compiled
def pull_block(measured: Measured, observed: Array, cotangent: Array) -> Float[Array, "lanes sample channel"]:
    return jax.vjp(lambda seen: residual_block(measured, seen), observed)[1](cotangent)[0]
