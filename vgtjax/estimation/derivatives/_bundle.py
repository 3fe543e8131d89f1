"""Traces laid out for batched simulation and for the segment-parallel Jacobian."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._types import Scalar
from ...plants import AbstractModel
from ...simulation import AbstractFixedMarch, AbstractStepping, CountedMarch, fixed, model_dtype
from ...traces import Drive, Start, Trace, cast, delay_duty, require
from ._layout import SEGMENT, Group, Layout, Shape, packed

CHANNELS = ("x_d", "p_act")
"""The measured signals, in the order of every array with a channel axis."""

Slope = tuple[Float[Array, "sample lanes"], Float[Array, "sample lanes"]]
"""Of what a delay moves, by that delay: of the duty in percent where it is linear or its mean counts, and of the place
of its knot."""


class Bundle(eqx.Module):
    """Traces that take the same steps, padded to equal length and cut into lanes of `SEGMENT` samples.

    `drive` has leaves `(time, traces)`; padded intervals have no duration, so nothing moves there. A lane is one
    segment of one trace: `lane_trace` and `lane_segment` say which. Trace `i` is number `numbers[i]` of the list that
    the bundle was made from, or none where that is -1; it has `samples[i]` times, and a duty that is late already by
    `duty_late[i]` s.
    """

    numbers: Int[np.ndarray, " traces"]
    samples: Int[np.ndarray, " traces"]
    duty_late: Float[np.ndarray, " traces"]
    plan: AbstractFixedMarch
    drive: Drive
    start: Start
    lane_drive: Drive
    lane_trace: Int[np.ndarray, " lanes"]
    lane_segment: Int[np.ndarray, " lanes"]

    @property
    def indices(self) -> tuple[int, ...]:
        """The numbers of its traces."""
        return tuple(self.numbers[self.numbers >= 0].tolist())

    @property
    def shape(self) -> Shape:
        """What its programs are compiled for."""
        length, traces = self.drive.duration.shape
        return Shape(length // SEGMENT, traces, len(self.lane_trace))

    @property
    def owned(self) -> int:
        """Lanes that belong to a trace: the first; others only fill up a shape."""
        return int(np.sum(self.segments))

    @property
    def segments(self) -> Int[np.ndarray, " traces"] | Int[Array, " traces"]:
        """How many segments each trace fills."""
        return -(-self.samples // SEGMENT)

    @property
    def rows(self) -> int:
        """Values of both channels in the lanes that belong to a trace."""
        return self.owned * SEGMENT * len(CHANNELS)

    def reversible(self) -> "Bundle":
        """The same traces for reverse mode."""
        return dataclasses.replace(self, plan=self.plan.reversible())

    def from_lanes(self, lanes: Float[np.ndarray, "lanes sample ..."]) -> list[np.ndarray]:
        """One array a trace, without padding."""
        trace = self.lane_trace[: self.owned]
        return [
            lanes[: self.owned][trace == i].reshape(-1, *lanes.shape[2:])[: self.samples[i]]
            for i in range(len(self.indices))
        ]

    def to_lanes(
        self, values: Sequence[np.ndarray], rows: Sequence[Int[np.ndarray, " _"]]
    ) -> Float[np.ndarray, "lanes sample ..."]:
        """Values of some rows of every trace of the list that the bundle was made from, in its layout; zero where there
        are none."""
        lanes = np.zeros((len(self.lane_trace) * SEGMENT, *values[0].shape[1:]))
        for trace, index in enumerate(self.indices):
            lanes[SEGMENT * self.first_lane(trace) + rows[index]] = values[index]
        return lanes.reshape(len(self.lane_trace), SEGMENT, *values[0].shape[1:])

    def with_late_duty(self, delay: Scalar) -> tuple["Bundle", Slope]:
        """The same traces with a duty that reaches the valve `delay` s late, and its slope by that in every lane."""
        drive, slope = self.late_duty(delay)
        lane_drive, lane_slope = jax.tree.map(self._cut, (drive, slope))
        late = eqx.tree_at(lambda bundle: (bundle.drive, bundle.lane_drive), self, (drive, lane_drive))
        return late, lane_slope

    def late_duty(self, delay: Scalar) -> tuple[Drive, Slope]:
        """Inputs with a duty that reaches the valve `delay` s late, and the slope of what the delay moves of them.

        A trace that is late already has its jumps where they are, and stays: what a delay moves of it beyond that is
        what its edges move, see [`Edges`][].
        """
        timely = jnp.asarray(self.duty_late) == 0

        def late(delay: Scalar) -> Drive:
            by_trace = jax.vmap(delay_duty, in_axes=(1, 0), out_axes=1)
            return by_trace(self.drive, jnp.where(timely, delay, 0.0))

        drive, moving = jax.jvp(late, (delay,), (jnp.ones_like(delay),))
        return drive, (moving.pwm, moving.knot.place)

    def _cut(self, values: Float[Array, "time traces"]) -> Float[Array, "sample lanes"]:
        """Values at every time of every trace, cut into lanes."""
        return values.reshape(-1, SEGMENT, values.shape[-1])[self.lane_segment, :, self.lane_trace].T

    def first_lane(self, trace: int) -> int:
        """Where the lanes of a trace begin."""
        return int(np.sum(self.segments[:trace]))


def _stack(arrays: Sequence[np.ndarray], length: int) -> np.ndarray:
    """Arrays side by side `(length, traces)`, padded by their last value."""
    return np.stack([np.pad(array, (0, length - len(array)), mode="edge") for array in arrays], axis=1)


def bundle_traces(
    model: AbstractModel,
    traces: Sequence[Trace],
    stepping: AbstractStepping | None = None,
    like: Sequence[Bundle] = (),
) -> list[Bundle]:
    """Bundles of traces that can run side by side: same steps an interval, same kind of input.

    **Arguments:** `like`: bundles of the same model whose programs are compiled already: what has room in the shape of
    one is laid out in that.

    **Raises:** `InputError` when a trace lacks a column that the model needs, or steps are not fixed.
    """
    steps = fixed(stepping)
    plans = [steps.plan(model, trace) for trace in traces]
    kinds: dict[Any, dict[int, Group]] = {}
    for index, (trace, plan) in enumerate(zip(traces, plans, strict=True)):
        require(trace, model.needs)
        drive = trace.drive()
        rates = kinds.setdefault(jax.tree.structure(drive), {})
        rates.setdefault(plan.substeps, {})[index] = Layout(trace, drive)
    bundles = []
    for kind, rates in kinds.items():
        for substeps, shape, group in packed(rates, _shapes(kind, like)):
            counted = CountedMarch(np.asarray(substeps), plans[0].solver)
            bundles.append(_bundle(group, shape, counted, model_dtype(model)))
    return bundles


def longest_like(trace: Trace, like: Sequence[Bundle]) -> int:
    """Samples of the longest trace with the same kinds of input that has room in the shape of one of these bundles."""
    return max((shape.longest for shape in _shapes(jax.tree.structure(trace.drive()), like)), default=0)


def _shapes(kind: Any, bundles: Sequence[Bundle]) -> list[Shape]:
    return [bundle.shape for bundle in bundles if jax.tree.structure(bundle.drive) == kind]


def _bundle(group: Group, shape: Shape, plan: CountedMarch, dtype: np.dtype) -> Bundle:
    """Traces, by their number, in a shape that has room for them: the longest first, so that fits side by side,
    which take a place of it at the same time, have traces of about one length there."""
    group = dict(sorted(group.items(), key=lambda item: -item[1].segments))
    empty = shape.traces - len(group)
    drives = [each.drive for each in group.values()]
    samples = [len(drive.duration) for drive in drives]
    segments = [each.segments for each in group.values()]
    # Padding holds the last inputs over no time at all: their rates are those of the last sample, zero.
    nothing = jax.tree.map(lambda leaf: leaf[-1:], drives[0])
    length = shape.segments * SEGMENT
    drive = jax.tree.map(lambda *leaves: _stack(leaves, length), *drives, *[nothing] * empty)
    starts = [each.trace.start() for each in group.values()]
    start = jax.tree.map(lambda *leaves: np.stack(leaves), *starts, *starts[:1] * empty)
    trace_of = np.repeat(np.arange(len(group)), segments)
    segment_of = np.concatenate([np.arange(count) for count in segments])
    fill = shape.lanes - len(trace_of)
    lane_trace, lane_segment = np.pad(trace_of, (0, fill)), np.pad(segment_of, (0, fill))

    def to_lanes(leaf: np.ndarray) -> np.ndarray:
        return leaf.reshape(shape.segments, SEGMENT, -1)[lane_segment, :, lane_trace].T

    lane_drive = jax.tree.map(to_lanes, drive)
    return Bundle(
        numbers=np.pad(np.array(list(group)), (0, empty), constant_values=-1),
        samples=np.pad(np.array(samples), (0, empty)),
        duty_late=np.pad([each.trace.duty_late for each in group.values()], (0, empty)).astype(dtype),
        plan=plan,
        drive=cast(drive, dtype),
        start=cast(start, dtype),
        lane_drive=cast(lane_drive, dtype),
        lane_trace=lane_trace,
        lane_segment=lane_segment,
    )
