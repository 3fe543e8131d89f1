"""What a fit finds of a bench besides parameters, as entries of the model as its bench sees it: gains and offsets of
sensors, and start states of traces."""

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from ..._errors import InputError
from ...parameters import Selection, select
from ...plants import AbstractModel, Initial, Instrumented, air_path_of
from ...traces import START_WINDOW, Trace
from ..derivatives import CHANNELS
from ._evidence import Unknown

SETTLING = 0.03
"""s after which friction, plunger and the rod's velocity have forgotten how they began; where they did is not free, so
what sensors show before that is no residual."""
LEAST_MOVED = {"x_d": 1e-4, "p_act": 1e3}
"""m and Pa; ten usual differences, to which searches come by themselves."""
FEWEST = 5
"""Samples of a parabola: with fewer it has no noise to lose."""


@dataclasses.dataclass(frozen=True, eq=False)
class Bench:
    """A model with its sensors, what of both is free, how well the sensors are known beforehand, by entry, and the
    traces, which know their start states by number."""

    model: AbstractModel
    selection: Selection
    deviations: dict[str, float]
    traces: Sequence[Trace]


def instrumented(
    model: AbstractModel,
    selection: Selection,
    traces: Sequence[Trace],
    unknown: Unknown,
    gains: Mapping[str, float],
    offsets: Mapping[str, float],
) -> Bench:
    """A model and what is free of it, with the gains, offsets and start states that are unknown, and those of inputs
    that are known to a tolerance; a model alone where there are none.

    **Arguments:** `gains`, `offsets` by channel: how well they are known beforehand, relative and in the unit.

    **Raises:** `InputError` for a sensor that a model neither is driven by nor is compared with, or a trace lacks.
    """
    inputs = inputs_of(model, traces)
    # The offset of what is fitted is eliminated in every trace: there is nothing more to find.
    shifted = [channel for channel in unknown.offset if channel in inputs or channel not in CHANNELS]
    starting = _starting(model, traces, unknown)
    wanted = [*(f"gain.{channel}" for channel in unknown.gain), *(f"offset.{channel}" for channel in shifted)]
    known = {f"gain.{channel}": part for channel, part in gains.items()}
    known |= {f"offset.{channel}": size for channel, size in offsets.items()}
    recorded = [channel for channel in inputs if any(channel in trace.channels for trace in traces)]
    counted = {*wanted, *(f"{kind}.{channel}" for channel in recorded for kind in ("gain", "offset"))}
    stated = {entry: size for entry, size in known.items() if entry in counted}
    if not (wanted or starting or stated):
        return Bench(model, selection, {}, traces)
    for channel in unknown.gain:
        _require(channel, "gain", (*CHANNELS, *inputs), traces)
    for channel in shifted:
        _require(channel, "offset", inputs, traces)
    later = {id(trace): _numbered(model, trace, number) for number, trace in enumerate(starting, 1)}
    bench = Instrumented(model, initial=_initial(model, [(trace, later[id(trace)]) for trace in starting]))
    for number, trace in enumerate(starting):
        wanted += [f"initial.{state}[{number}]" for state in _free_states(model, trace)]
    numbered = [later.get(id(trace), trace) for trace in traces]
    return Bench(bench, select(bench, [*selection.entries, *wanted]), stated, numbered)


def _starting(model: AbstractModel, traces: Sequence[Trace], unknown: Unknown) -> list[Trace]:
    """Traces whose start state is free: those that move from the first, or all where that is asked for.

    A rod alone forgets how it began within milliseconds, so that it is asked only if that is asked for.
    """
    if not unknown.start_state or (unknown.start_state == "evidence" and "pwm" not in model.needs):
        return []
    seen = [trace for trace in traces if any(channel in trace.channels for channel in model.sensed)]
    return [trace for trace in seen if not trace.start().at_rest or unknown.start_state is True]


def _free_states(model: AbstractModel, trace: Trace) -> list[str]:
    """What of a start state is free: what sensors see, and the temperature of gas that has one."""
    seen = [channel for channel in model.sensed if channel in trace.channels]
    path = air_path_of(model)
    return seen if path is None or not path.chamber.has_temperature else [*seen, "T_act"]


def _numbered(model: AbstractModel, trace: Trace, number: int) -> Trace:
    """A trace that knows its start state, without what its sensors show before everything else has settled."""
    seen = {channel: trace.channels[channel] for channel in model.sensed if channel in trace.channels}
    later = {channel: each.time >= trace.time[0] + SETTLING for channel, each in seen.items()}
    kept = {
        channel: dataclasses.replace(each, time=each.time[later[channel]], value=each.value[later[channel]])
        for channel, each in seen.items()
        if np.any(later[channel])
    }
    return trace.replace(start_number=number, **kept)


def _initial(model: AbstractModel, traces: Sequence[tuple[Trace, Trace]]) -> Initial:
    """By how much traces begin elsewhere than where the numbered ones would have them begin, as far as their first
    samples tell; zero for what hardly moves, and for what is no sensor of the model.

    A rod that has gone two millimetres on is two hundred usual differences away, where no search comes to.

    **Arguments:** `traces`: each whole, and numbered.
    """
    moved = np.zeros((2, len(traces)))
    for number, (whole, later) in enumerate(traces):
        mean = later.start()
        for place, (channel, value) in enumerate((("x_d", mean.position), ("p_act", mean.pressure))):
            away = _first_value(whole, channel) - float(value) if channel in model.sensed else 0.0
            moved[place, number] = away if abs(away) > LEAST_MOVED[channel] else 0.0
    return Initial(jnp.asarray(moved[0]), jnp.asarray(moved[1]), jnp.zeros(len(traces)))


def _first_value(trace: Trace, channel: str) -> float:
    """Where a channel begins by a parabola through its first samples; NaN without enough of them."""
    seen = trace.channels.get(channel)
    first = None if seen is None else seen.within(trace.time[0], trace.time[0] + START_WINDOW)
    if first is None or len(first.time) < FEWEST:
        return np.nan
    return float(np.polyfit(first.time - trace.time[0], first.value, 2)[-1])


def inputs_of(model: AbstractModel, traces: Sequence[Trace]) -> tuple[str, ...]:
    """Channels by which a model is driven, but for the duty."""
    if "p_act" in model.sensed:
        return ("p_res", "p_trb")
    driven = any("f_drive" in trace.channels for trace in traces)
    return ("f_drive" if driven else "p_act", "p_trb")


def _require(channel: str, kind: str, known: Sequence[str], traces: Sequence[Trace]) -> None:
    if channel not in known:
        raise InputError(
            f"the {kind} of a sensor that may be free is that of one of {', '.join(dict.fromkeys(known))} with this "
            f"model, but it is '{channel}'; drop it",
            "unknown",
        )
    for trace in traces:
        if channel not in trace.channels:
            raise InputError(
                f"{trace.name}: a free {kind} of {channel} needs that column, but the trace has none; drop it, or "
                "record it",
                "unknown",
            )
