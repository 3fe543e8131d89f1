"""Traces laid out for batched simulation and for the segment-parallel Jacobian."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._lanes import fill_devices
from .._types import Scalar
from ..plants import AbstractModel
from ..simulation import FixedMarch, FixedStep, model_dtype
from ..traces import Drive, Start, Trace, cast, delay_duty, require

SEGMENT = 50
"""Samples a segment of the parallel Jacobian: long enough that chaining segments costs little, short enough for many
lanes. Between 25 and 100 its time changes by a tenth."""

CHANNELS = ("x_d", "p_act")
"""The measured signals, in the order of every array with a channel axis."""


class Bundle(eqx.Module):
    """Traces that take the same steps, padded to equal length and cut into lanes of `SEGMENT` samples.

    `drive` has leaves `(time, traces)`; padded intervals have no duration, so nothing moves there. A lane is one
    segment of one trace: `lane_trace` and `lane_segment` say which. `samples[i]` is the number of times of trace `i`,
    which is trace number `indices[i]` of the list that the bundle was made from.
    """

    indices: tuple[int, ...] = eqx.field(static=True)
    samples: Int[np.ndarray, " traces"]
    plan: FixedMarch
    drive: Drive
    start: Start
    lane_drive: Drive
    lane_trace: Int[np.ndarray, " lanes"]
    lane_segment: Int[np.ndarray, " lanes"]

    def from_lanes(self, lanes: Float[np.ndarray, "lanes sample ..."]) -> list[np.ndarray]:
        """One array a trace, without padding."""
        owned = self._owned()
        return [
            lanes[owned[self.lane_trace[owned] == i]].reshape(-1, *lanes.shape[2:])[:count]
            for i, count in enumerate(self.samples)
        ]

    def with_late_duty(self, delay: Scalar) -> tuple["Bundle", Float[Array, "sample lanes"]]:
        """The same traces with a duty that reaches the valve `delay` s late, and its slope by that in every lane."""
        recorded, duration = self.drive.pwm, self.drive.duration
        assert recorded is not None, "only a duty can be late"

        def duty(delay: Scalar) -> Float[Array, "time traces"]:
            return jax.vmap(delay_duty, in_axes=(1, 1, None), out_axes=1)(recorded, duration, delay)

        late, slope = jax.jvp(duty, (delay,), (jnp.ones_like(delay),))
        drives = (lambda bundle: bundle.drive.pwm, lambda bundle: bundle.lane_drive.pwm)
        bundle = eqx.tree_at(lambda bundle: [get(bundle) for get in drives], self, [late, self._cut(late)])
        return bundle, self._cut(slope)

    def _cut(self, values: Float[Array, "time traces"]) -> Float[Array, "sample lanes"]:
        """Values at every time of every trace, cut into lanes."""
        return values.reshape(-1, SEGMENT, values.shape[-1])[self.lane_segment, :, self.lane_trace].T

    def first_lane(self, trace: int) -> int:
        """Where the lanes of a trace begin."""
        return int(np.sum(-(-self.samples[:trace] // SEGMENT)))

    def _owned(self) -> Int[np.ndarray, " owned"]:
        """Lanes that belong to a trace; those that only fill up a device follow them."""
        return np.arange(int(np.sum(-(-self.samples // SEGMENT))))


def _stack(arrays: Sequence[np.ndarray], length: int, fill: float | None) -> np.ndarray:
    """Arrays side by side `(length, traces)`, padded by `fill` or by their last value."""
    columns = []
    for array in arrays:
        tail = np.full(length - len(array), array[-1] if fill is None else fill, dtype=array.dtype)
        columns.append(np.concatenate([array, tail]))
    return np.stack(columns, axis=1)


def bundle_traces(model: AbstractModel, traces: Sequence[Trace], stepping: FixedStep | None = None) -> list[Bundle]:
    """Bundles of traces that can run side by side: same steps an interval, same kind of input.

    **Raises:** `InputError` when a trace lacks a column that the model needs, or steps are not fixed.
    """
    stepping = FixedStep() if stepping is None else stepping
    plans: dict[Any, FixedMarch] = {}
    groups: dict[Any, list[int]] = {}
    for index, trace in enumerate(traces):
        require(trace, model.needs)
        plan = stepping.plan_intervals(model, trace.longest_interval)
        key = (plan.substeps, jax.tree.structure(trace.drive()))
        plans[key] = plan
        groups.setdefault(key, []).append(index)
    return [_bundle(model, [traces[i] for i in indices], indices, plans[key]) for key, indices in groups.items()]


def _bundle(model: AbstractModel, traces: list[Trace], indices: list[int], plan: FixedMarch) -> Bundle:
    dtype = model_dtype(model)
    samples = [len(trace.time) for trace in traces]
    segments = [-(-count // SEGMENT) for count in samples]
    length = max(segments) * SEGMENT
    drives = [trace.drive() for trace in traces]
    drive = jax.tree.map(lambda *leaves: _stack(leaves, length, None), *drives)
    # Padding holds the last inputs over no time at all: their rates are those of the last sample, zero.
    start = jax.tree.map(lambda *leaves: np.stack(leaves), *[trace.start() for trace in traces])
    trace_of = np.repeat(np.arange(len(traces)), segments)
    segment_of = np.concatenate([np.arange(count) for count in segments])
    fill = fill_devices(len(trace_of)) - len(trace_of)
    lane_trace, lane_segment = np.pad(trace_of, (0, fill)), np.pad(segment_of, (0, fill))

    def to_lanes(leaf: np.ndarray) -> np.ndarray:
        return leaf.reshape(max(segments), SEGMENT, -1)[lane_segment, :, lane_trace].T

    lane_drive = jax.tree.map(to_lanes, drive)
    return Bundle(
        indices=tuple(indices),
        samples=np.asarray(samples),
        plan=plan,
        drive=cast(drive, dtype),
        start=cast(start, dtype),
        lane_drive=cast(lane_drive, dtype),
        lane_trace=lane_trace,
        lane_segment=lane_segment,
    )
