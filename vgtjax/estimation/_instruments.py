"""Sensors whose gain or offset a fit finds besides the parameters: entries of the model as its bench sees it."""

import dataclasses
from collections.abc import Mapping, Sequence

from .._errors import InputError
from ..parameters import Selection, select
from ..plants import AbstractModel, Instrumented, MechanicalActuator
from ..traces import Trace
from ._evidence import Unknown


@dataclasses.dataclass(frozen=True, eq=False)
class Bench:
    """A model with its sensors, what of both is free, and how well the sensors are known beforehand, by entry."""

    model: AbstractModel
    selection: Selection
    deviations: dict[str, float]


def instrumented(
    model: AbstractModel,
    selection: Selection,
    traces: Sequence[Trace],
    unknown: Unknown,
    gains: Mapping[str, float],
    offsets: Mapping[str, float],
) -> Bench:
    """A model and what is free of it, with the gains and offsets that are unknown; a model alone where there are none.

    **Arguments:** `gains`, `offsets` by channel: how well they are known beforehand, relative and in the unit.

    **Raises:** `InputError` for a sensor that a model neither is driven by nor is compared with, or a trace lacks.
    """
    inputs = _inputs(model, traces)
    # The offset of what is fitted is eliminated in every trace: there is nothing more to find.
    shifted = [channel for channel in unknown.offset if channel in inputs or channel not in ("x_d", "p_act")]
    if not (unknown.gain or shifted):
        return Bench(model, selection, {})
    for channel in unknown.gain:
        _require(channel, "gain", ("x_d", "p_act", *inputs), traces)
    for channel in shifted:
        _require(channel, "offset", inputs, traces)
    bench = Instrumented(model)
    wanted = [*(f"gain.{channel}" for channel in unknown.gain), *(f"offset.{channel}" for channel in shifted)]
    known = {f"gain.{channel}": part for channel, part in gains.items()}
    known |= {f"offset.{channel}": size for channel, size in offsets.items()}
    stated = {entry: size for entry, size in known.items() if entry in wanted}
    return Bench(bench, select(bench, [*selection.entries, *wanted]), stated)


def _inputs(model: AbstractModel, traces: Sequence[Trace]) -> tuple[str, ...]:
    """Channels by which a model is driven, but for the duty."""
    if not isinstance(model, MechanicalActuator):
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
