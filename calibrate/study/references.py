"""`[[control.reference]]`: a reference of the position by its kind, each with keys of its own; m, s, rad/s."""

import math
import pathlib
from collections.abc import Sequence
from typing import Annotated, Literal, get_args

import jax.numpy as jnp
import pydantic

import vgtjax
from vgtjax.traces.files import open_recording

from .base import Finite, NotNegative, Positive, Table
from .channels import ChannelName, Channels, sources_of
from .places import StudyError

OTHERS = tuple(name for name in get_args(ChannelName) if name not in ("time", "x_d"))
"""Channels that no reference needs."""


class AbstractReference(Table):
    """What references of every kind share; a key that is left out has the default of the library."""

    kind: str
    """Which it is."""
    name: str | None = None
    """What reports call it; else its kind."""
    begin: NotNegative = 0.0
    """s of the signal at which runs begin."""

    @property
    def title(self) -> str:
        """What it is called: its kind where the study gives it no name."""
        return self.name or self.kind


class SineReference(AbstractReference):
    """`offset + amplitude sin(rate t + phase)`."""

    kind: Literal["sine"]
    amplitude: Finite
    """m"""
    rate: Positive
    """rad/s"""
    offset: Finite | None = None
    """m; zero if it is left out."""
    phase: Finite | None = None
    """rad; zero if it is left out."""


class StepsReference(AbstractReference):
    """Smooth steps to `levels` that begin at `times`."""

    kind: Literal["steps"]
    times: list[Finite]
    """s at which steps begin."""
    levels: list[Finite]
    """m; where each of them leads."""
    initial: Finite | None = None
    """m before the first; zero if it is left out."""
    rise: Positive | None = None
    """s that a step takes; 0.1 if it is left out."""


class RampsReference(AbstractReference):
    """Straight lines through `levels` at `times`, with round corners."""

    kind: Literal["ramps"]
    times: list[Finite]
    """s"""
    levels: list[Finite]
    """m at these times."""
    rounding: Positive | None = None
    """s over which a corner is round; 0.1 if it is left out."""


class PrintedReference(AbstractReference):
    """One of the thesis's two signals [5.44, 5.45]."""

    kind: Literal["signal-1", "signal-2"]
    rise: Positive | None = None
    """s over which `signal-1` grows, or the step of `signal-2` takes; 1 and 0.5 if it is left out."""


class TraceReference(AbstractReference):
    """The measured position of a trace."""

    kind: Literal["trace"]
    file: str
    """Relative to the study file; `[channels]` says where position and time are in it."""


SIGNALS = {"sine": "Sine", "steps": "Steps", "ramps": "Ramps", "signal-1": "signal_1", "signal-2": "signal_2"}
"""What makes a signal of a kind, in `vgtjax.control`, which only commands with closed loops import."""
Reference = Annotated[
    SineReference | StepsReference | RampsReference | PrintedReference | TraceReference,
    pydantic.Field(discriminator="kind"),
]

TUNED_ON: list[Reference] = [
    SineReference(kind="sine", amplitude=0.003, rate=1.0, offset=0.005),
    StepsReference(kind="steps", times=[1.0, 3.5, 6.0], levels=[0.003, 0.008, 0.005], initial=0.002, rise=0.5),
]
"""References that gains are tuned on where the study names none."""
TRIED_ON: list[Reference] = [
    PrintedReference(kind="signal-1", begin=10.0),
    RampsReference(kind="ramps", times=[0.5, 3.0, 4.0, 7.0], levels=[0.001, 0.009, 0.009, 0.004]),
    PrintedReference(kind="signal-2"),
]
"""References that tuned gains are tried on where the study names none."""


def cycle(entry: AbstractReference) -> float:
    """s after which a reference repeats itself; zero for one that does not."""
    match entry:
        case SineReference(rate=rate):
            return 2 * math.pi / rate
        case PrintedReference(kind="signal-1"):
            return vgtjax.control.SIGNAL_1_PERIOD
    return 0.0


def build_references(
    entries: Sequence[AbstractReference], folder: pathlib.Path, channels: Channels
) -> "dict[str, vgtjax.control.AbstractSignal]":
    """Signals in m by name, which is the kind where the study gives none; `channels` of the study say where traces have
    them."""
    signals: dict[str, vgtjax.control.AbstractSignal] = {}
    for entry in entries:
        name = entry.title
        if name in signals:
            raise StudyError(f"two references are called '{name}'; give each its own name")
        signal = _signal(entry, folder, channels)
        signals[name] = vgtjax.control.Later(signal, jnp.asarray(entry.begin)) if entry.begin > 0 else signal
    return signals


def _found_in(path: pathlib.Path, channels: Channels) -> dict[str, vgtjax.Source]:
    """What a study says of time and position, without the names that a file does not have: a reference may be in our
    own form beside traces of a logger, e.g. one that was simulated."""
    mine = {name: table for name, table in channels.items() if name in ("time", "x_d")}
    names = {None, *(entry.label for entry in open_recording(path).entries)} if mine else set()
    return sources_of({name: table for name, table in mine.items() if {table.name, table.time} <= names})


def _signal(entry: AbstractReference, folder: pathlib.Path, channels: Channels) -> "vgtjax.control.AbstractSignal":
    """Position in m over time, from the signal's own beginning; files lie in `folder`."""
    if isinstance(entry, TraceReference):
        path = folder / entry.file
        trace = vgtjax.load_trace(path, channels=_found_in(path, channels), needs=("x_d",), ignore=OTHERS)
        position = trace.channels["x_d"]
        return vgtjax.control.Sampled.through(position.time - trace.time[0], position.value)
    stated = sorted(entry.model_fields_set - {"kind", "name", "begin"})
    return getattr(vgtjax.control, SIGNALS[entry.kind])(**{key: getattr(entry, key) for key in stated})
