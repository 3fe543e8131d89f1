"""Exact derivatives of simulated traces with respect to parameters, over segments of time in parallel.

Forward mode, reordered: segments are lanes from their known start states, whose transition matrices are chained.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._errors import SimulationError
from ..._kept import keep_compiled, keep_compiled_for_once
from ..._lanes import Chunks, replicate, spread
from ..._types import Scalar
from ...parameters import Selection, select
from ...parts import with_tables
from ...plants import AbstractModel, State, rows_along
from ...simulation import RESULTS, FixedStep, check_result
from ...traces import Drive, Trace
from ._adjoint import pull_back
from ._bundle import CHANNELS, Bundle, Slope, bundle_traces
from ._by_rows import ByRows
from ._layout import SEGMENT
from ._trajectories import Lanes, Segments, trajectories
from ._values import Choose, Pushed, chooser, push_all, push_values, values_before

TraceJacobian = Float[np.ndarray, "time 2 parameters"] | dict[str, Float[np.ndarray, "samples parameters"]]
LaneJacobian = Float[Array, "lanes sample channel parameters"]
Inputs = tuple[Drive, Slope | None]

TOGETHER = 256
"""Bytes of a number in the lanes of a device that take their tangents through a segment together: 32 lanes in double
precision. A Jacobian of five traces takes 0.7 of the time of 8 lanes, a vector of 512 bits, and as long as with 64."""


def jacobian(
    model: AbstractModel,
    traces: Sequence[Trace],
    free: Sequence[str] | None = None,
    *,
    fixed: Sequence[str] = (),
    stepping: FixedStep | None = None,
) -> list[TraceJacobian]:
    """Derivatives of `x_d` (m) and `p_act` (Pa) with respect to the free parameters (units of the table), by trace.

    **Returns:** for a trace with one clock an array `(time, 2, parameters)`; for one whose channels have clocks of
    their own, or invalid samples, one array `(samples, parameters)` for each of `x_d` and `p_act` that was measured,
    by name, at its valid samples.

    **Arguments:**

    - `free`, `fixed`: names or fnmatch patterns, as in a study; all that is not held by default.
    - `stepping`: fixed steps, 0.5 ms by default.

    The last axis is in the order of `select(model, free, fixed).entries`. With several JAX devices (also of one
    CPU, see [`configure`][]) the segments are spread over them. Rates of a part of one's own need a reverse mode.

    **Raises:** `InputError` for a name that matches nothing; `SimulationError` when a simulation fails, or its
    derivatives leave the finite numbers.
    """
    selection = select(model, free, fixed)
    found: dict[int, TraceJacobian] = {}
    for bundle in bundle_traces(model, traces, stepping):
        observed, derivatives, ended = observe_with_jacobian(model, selection, bundle)
        on_host = jax.tree.map(np.asarray, ended)
        ends = [jax.tree.map(lambda end, at=at: end[at], on_host) for at in range(len(bundle.indices))]
        lanes = (bundle.from_lanes(np.asarray(each)) for each in (observed, derivatives))
        for index, *parts in zip(bundle.indices, ends, *lanes, strict=True):
            found[index] = _of_trace(traces[index], *parts)
    return [found[index] for index in range(len(traces))]


def _of_trace(trace: Trace, end: RESULTS, values: np.ndarray, columns: np.ndarray) -> TraceJacobian:
    """Its derivatives, if they may be used."""
    check_result(columns, end, f"the simulation of trace '{trace.name}'")
    # One bad number makes a sum bad, and a sum is the cheapest look at millions of them.
    if not np.isfinite(np.sum(values) + np.sum(columns)):
        raise SimulationError(
            f"derivatives of trace '{trace.name}' left the finite numbers; check that the parameters are physical, "
            "then lower max_step"
        )
    return columns if trace.has_common_clock else _by_channel(trace, columns)


def _by_channel(trace: Trace, columns: Float[np.ndarray, "time channel parameters"]) -> dict[str, np.ndarray]:
    """Rows of a Jacobian at the samples of each measured channel."""
    return {
        name: columns[trace.rows(name), channel]
        for channel, name in enumerate(CHANNELS)
        if trace.sampled(name) is not None
    }


@keep_compiled
def observe(model: AbstractModel, bundle: Bundle, delay: Scalar | None = None) -> tuple[Lanes, RESULTS]:
    """What the sensors would see along every trace of a bundle, position in m and pressure in Pa absolute, and how the
    simulation of each trace ended.

    **Arguments:** `delay` in s with which the duty reaches the valve.
    """
    bundle = bundle if delay is None else bundle.with_late_duty(delay)[0]
    return trajectories(model, bundle, bundle.segments)[1:]


def observe_with_jacobian(
    model: AbstractModel, selection: Selection, bundle: Bundle, delay: Scalar | None = None
) -> tuple[Lanes, LaneJacobian, RESULTS]:
    """What `observe` sees, its derivatives with respect to the selected parameters in the units of the table, and how
    each simulation ended.

    With a `delay` in s of the duty, the derivative with respect to it comes last.
    """
    values = replicate(values_before(model, selection, bundle))
    return _spread_jacobian(model, selection, bundle, delay, values)


def observe_backwards(
    model: AbstractModel, selection: Selection, bundle: Bundle, delay: Scalar | None, cotangent: Array | np.ndarray
) -> Float[Array, " parameters"]:
    """See [`pull_back`][]."""
    values = values_before(model, selection, bundle)
    return _pulled_back(model, selection, bundle.reversible(), delay, jnp.asarray(cotangent), values)


def prepare(
    model: AbstractModel,
    selection: Selection | None,
    bundle: Bundle,
    delay: Scalar | None,
    cotangent: Array | np.ndarray | None,
) -> None:
    """Compiles what answers `observe`, `observe_with_jacobian` or `observe_backwards` of a model without tables, and
    runs nothing."""
    if selection is None:
        observe.prepare(model, bundle, delay)
    elif cotangent is None:
        _spread_jacobian.prepare(model, selection, bundle, delay, None)
    else:
        _pulled_back.prepare(model, selection, bundle.reversible(), delay, jnp.asarray(cotangent), None)


@keep_compiled
def _spread_jacobian(
    model: AbstractModel, selection: Selection, bundle: Bundle, delay: Scalar | None, values: Pushed | None
) -> tuple[Lanes, LaneJacobian, RESULTS]:
    return _linearise(model, selection, bundle, delay, values)


@keep_compiled_for_once
def _pulled_back(
    model: AbstractModel,
    selection: Selection,
    bundle: Bundle,
    delay: Scalar | None,
    cotangent: Array,
    values: Pushed | None,
) -> Float[Array, " parameters"]:
    return _backwards(model, selection, bundle, delay, cotangent, values)


@keep_compiled
def observe_together(
    dynamic: tuple[Any, ...],
    static: tuple[Any, ...],
    substeps: Int[np.ndarray, ""] | Int[Array, ""],
    segments: Segments,
) -> tuple[Float[Array, "fits lanes sample channel"] | None, Float[Array, "fits ..."] | None, RESULTS | None]:
    """What is observed of many fits, their derivatives and ends, each on one device: `observe` of each, or
    `observe_with_jacobian` where there is a selection, or `observe_backwards` where there is a cotangent.

    **Arguments:** the arrays of `(model, selection, bundle, delay, cotangent)` with a leading axis of fits, the rest of
    it, and of all of them the steps an interval and the most segments that a trace in each place fills: those of its
    own would make every fit wait for the others.
    """

    def one(leaves: tuple[Any, ...]) -> tuple[Array | None, Array | None, RESULTS | None]:
        model, selection, bundle, delay, cotangent = eqx.combine(leaves, static)
        bundle = eqx.tree_at(lambda bundle: bundle.plan.substeps, bundle, substeps)
        if cotangent is not None:
            return None, _backwards(model, selection, bundle, delay, cotangent), None
        if selection is not None:
            return _linearise(model, selection, bundle, delay, segments=segments)
        bundle = bundle if delay is None else bundle.with_late_duty(delay)[0]
        _, observed, ended = trajectories(model, bundle, segments)
        return observed, None, ended

    return jax.vmap(one)(dynamic)


def _backwards(
    model: AbstractModel,
    selection: Selection,
    bundle: Bundle,
    delay: Scalar | None,
    cotangent: Array,
    values: Pushed | None = None,
) -> Float[Array, " parameters"]:
    """See [`pull_back`][]; `values` are those that `push_values` gives."""
    values = push_values(model, selection, rows_along(model, bundle.drive)) if values is None else values
    return pull_back(model, selection, bundle, delay, cotangent, values)


def _linearise(
    model: AbstractModel,
    selection: Selection,
    bundle: Bundle,
    delay: Scalar | None,
    values: Pushed | None = None,
    segments: Segments | None = None,
) -> tuple[Lanes, LaneJacobian, RESULTS]:
    """What is observed, its derivatives and how the simulations ended, on all devices, or on one with the `segments`
    that traces of all fits fill at most; `values` are those that `push_values` gives."""
    place, devices = (spread, jax.device_count()) if segments is None else (_here, 1)
    segments = bundle.segments if segments is None else segments
    slope = None
    if delay is not None:
        bundle, slope = bundle.with_late_duty(delay)
    # Tables are made once, not at every step.
    values = push_values(model, selection, rows_along(model, bundle.drive)) if values is None else values

    choose = chooser(model, selection)
    first, observed, ended = trajectories(with_tables(model, values[0][1]), bundle, segments)
    first, inputs = place((first, (bundle.lane_drive, slope)))

    ends, by_start, by_parameter = _push_chunks(choose, values, first, inputs, bundle, segments, place, devices)
    at_start = _chain(choose, values, bundle, ends)
    # A sum of products over seven states, lanes innermost: one fused loop, where a dot would transpose everything.
    total = by_parameter
    for state in range(at_start.shape[1]):
        total = total + by_start[:, state, None] * at_start[:, state].T[None, :, None]
    return observed, jnp.transpose(total, (3, 0, 2, 1)), ended


def _here(tree: Any) -> Any:
    """Arrays where they are: on the one device of a fit beside others."""
    return tree


def _push_chunks(
    choose: Choose,
    values: Pushed,
    first: State,
    inputs: Inputs,
    bundle: Bundle,
    segments: Segments,
    place: Callable[[Any], Any],
    devices: int,
) -> tuple[Array, Array, Array]:
    """`_push_lanes`, a `TOGETHER` of lanes of every device at a time: those that traces have `segments` for, which
    `place` spreads over so many devices in the order that they are in.

    Those that only fill up a shape repeat its first lane, and have its tangents.
    """
    lanes, mine = len(bundle.lane_trace), jnp.sum(jnp.asarray(bundle.segments))
    layout = Chunks(lanes, devices, TOGETHER // jax.tree.leaves(first)[0].dtype.itemsize)
    chunks = jnp.minimum(-(-jnp.sum(jnp.asarray(segments)) // layout.together), layout.count)
    cuts = place(jax.tree.map(layout.cut, (first, inputs)))

    def push(number):
        mine = jax.tree.map(lambda leaf: jax.lax.dynamic_index_in_dim(leaf, number, 0, keepdims=False), cuts)
        ends, by_start, by_parameter = _push_lanes(choose, values, *place(mine), bundle)
        return place((jnp.moveaxis(ends, 0, -1), by_start, by_parameter))

    def onward(number, found):
        return jax.tree.map(
            lambda all_, each: jax.lax.dynamic_update_index_in_dim(all_, each, number, 0), found, push(number)
        )

    # Shapes are written down: to ask JAX for them would trace all steps and their derivatives twice.
    states, kind = len(jax.tree.leaves(first)), jax.tree.leaves(first)[0].dtype
    known, samples = len(jax.tree.leaves(values[1])[0]) + (inputs[1] is not None), len(jax.tree.leaves(inputs)[0])
    shapes = ((states, states + known), (samples, states, len(CHANNELS)), (samples, known, len(CHANNELS)))
    nothing = tuple(jnp.zeros((layout.count, *shape, layout.width), kind) for shape in shapes)
    found = jax.lax.fori_loop(0, chunks, onward, place(nothing))

    def joined(leaf):
        side_by_side = layout.join(leaf)
        return jnp.where(jnp.arange(lanes) < mine, side_by_side, side_by_side[..., :1])

    ends, by_start, by_parameter = map(joined, found)
    return jnp.moveaxis(ends, -1, 0), by_start, by_parameter


def _push_lanes(
    choose: Choose, values_and_tangents: Pushed, first: State, inputs: Inputs, bundle: Bundle
) -> tuple[Array, Array, Array]:
    """Tangents through every lane for its start states and for the parameters.

    `choose` makes the model of values, which come with a tangent for each parameter; `inputs` are those of every lane,
    and the slope of its duty by the delay, if that is one of the parameters.

    **Returns:** tangents of the end states `(lanes, states, tangents)`, and those of what is observed, split into
    `(sample, states, channel, lanes)` and `(sample, parameters, channel, lanes)`.
    """
    values, by_parameter = values_and_tangents
    leaves, shape = jax.tree.flatten(first)
    states, lanes = len(leaves), leaves[0].shape[0]
    late = inputs[1] is not None
    identity = jnp.eye(states + len(jax.tree.leaves(by_parameter)[0]) + late, dtype=leaves[0].dtype)
    state_tangents = [jnp.broadcast_to(identity[i, :, None], (len(identity), lanes)) for i in range(states)]
    values_tangents = jax.tree.map(
        lambda leaf: jnp.pad(leaf, [(states, int(late)), *[(0, 0)] * (leaf.ndim - 1)]), by_parameter
    )
    delay_tangents = identity[:, -1] if late else None

    plan = bundle.plan

    def interval(carry, inputs):
        drive, slope = inputs

        def push(function, carry):
            at, tangents = carry

            def along(dvalues, moved, ddelay):
                by_delay = () if ddelay is None else (tuple(ddelay * each for each in slope),)
                given = (values, at) if ddelay is None else (values, at, drive.duty)
                return jax.jvp(functools.partial(function, drive), given, (dvalues, moved, *by_delay))

            return jax.vmap(along, out_axes=(None, 0))(values_tangents, tangents, delay_tangents)

        def observe(drive, values, state, duty=None):
            return jnp.stack(jax.vmap(choose(values).observe)(state, _with_duty(drive, duty)))

        def begin(drive, values, state, duty=None):
            return jax.vmap(lambda y, u: plan.begin(choose(values), y, u))(state, _with_duty(drive, duty))

        def step(number, drive, values, carried, duty=None):
            chosen = ByRows(choose(values), plan.substeps > 0)
            each = jax.vmap(lambda y, u: plan.step(chosen, y, u, number)[0])
            return each(carried, _with_duty(drive, duty))

        def one(carry, number):
            return push(functools.partial(step, number), carry)

        (state, _), (tangents, _) = plan.repeat(one, push(begin, carry), drive.steps(plan.substeps))
        return (state, tangents), push(observe, carry)[1]

    start = (first, jax.tree.unflatten(shape, state_tangents))
    (_, ends), observed = jax.lax.scan(interval, start, inputs)
    end_tangents = jnp.transpose(jnp.stack(jax.tree.leaves(ends)), (2, 0, 1))
    return end_tangents, observed[:, :states], observed[:, states:]


def _with_duty(drive: Drive, duty: Any) -> Drive:
    return drive if duty is None else drive.with_duty(duty)


def _chain(
    choose: Choose, values_and_tangents: Pushed, bundle: Bundle, tangents: Array
) -> Float[Array, "lanes states parameters"]:
    """Derivatives of every lane's start state with respect to the parameters: segments chained along each trace.

    **Arguments:** as of `_push_lanes`, and the tangents of the end states that come out of it.
    """
    traces = bundle.start.at_rest.shape[0]
    segments = jax.tree.leaves(bundle.drive)[0].shape[0] // SEGMENT
    table = jnp.zeros((segments, traces, *tangents.shape[1:]), tangents.dtype)
    table = table.at[bundle.lane_segment, bundle.lane_trace].set(tangents)
    states = tangents.shape[1]

    def start_states(values):
        chosen = choose(values)
        begin = jax.tree.map(lambda leaf: leaf[0], bundle.drive)
        return jnp.stack(jax.tree.leaves(jax.vmap(chosen.start)(bundle.start, begin)), axis=1)

    def segment(sensitivity, transition):
        following = transition[..., :states] @ sensitivity + transition[..., states:]
        return following, sensitivity

    initial = jnp.moveaxis(push_all(start_states, *values_and_tangents)[1], 0, -1)
    # The duty before the first sample is that of the first, so a delay does not move the start; nor does it where a
    # linear duty comes early, but for the little by which that has changed by then.
    initial = jnp.pad(initial, [(0, 0), (0, 0), (0, tangents.shape[-1] - states - initial.shape[-1])])
    return jax.lax.scan(segment, initial, table)[1][bundle.lane_segment, bundle.lane_trace]
