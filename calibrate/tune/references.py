"""References by the tables of a study."""

import pathlib
from collections.abc import Sequence
from typing import Any

import vgtjax
from vgtjax import InputError
from vgtjax.control import AbstractSignal, Later, Ramps, Sampled, Sine, Steps, signal_1, signal_2

from ..study.tables import ReferenceEntry

KEYS: dict[str, tuple[Any, tuple[str, ...], tuple[str, ...]]] = {
    "sine": (Sine, ("amplitude", "rate"), ("offset", "phase")),
    "steps": (Steps, ("times", "levels"), ("initial", "rise")),
    "ramps": (Ramps, ("times", "levels"), ("rounding",)),
    "signal-1": (signal_1, (), ("rise",)),
    "signal-2": (signal_2, (), ("rise",)),
}
"""What makes the signal of a kind, the keys that it needs, and those that it may have."""
TRACE_KEYS = ("file",)
DEFAULT = (
    ReferenceEntry(kind="sine", amplitude=0.003, rate=1.0, offset=0.005),
    ReferenceEntry(kind="steps", times=[1.0, 3.5, 6.0], levels=[0.003, 0.008, 0.005], initial=0.002, rise=0.5),
)
"""References that gains are tuned on where the study names none: m, s."""
DEFAULT_UNSEEN = (
    ReferenceEntry(kind="signal-1", begin=10.0),
    ReferenceEntry(kind="ramps", times=[0.5, 3.0, 4.0, 7.0], levels=[0.001, 0.009, 0.009, 0.004]),
    ReferenceEntry(kind="signal-2"),
)
"""References that tuned gains are tried on where the study names none."""


def build_references(entries: Sequence[ReferenceEntry], folder: pathlib.Path) -> dict[str, AbstractSignal]:
    """Signals in m by name, which is the kind where the study gives none.

    **Raises:** `InputError` for keys that a kind lacks or does not have, or for two references of one name.
    """
    signals: dict[str, AbstractSignal] = {}
    for entry in entries:
        name = entry.kind if entry.name is None else entry.name
        if name in signals:
            raise InputError(f"two references are called '{name}'; give each its own name")
        signal = _build(entry, folder)
        signals[name] = Later(signal, entry.begin) if entry.begin > 0 else signal
    return signals


def _build(entry: ReferenceEntry, folder: pathlib.Path) -> AbstractSignal:
    make, needed, allowed = (_from_trace, TRACE_KEYS, ()) if entry.kind == "trace" else KEYS[entry.kind]
    given = entry.given
    missing = [key for key in needed if key not in given]
    if missing:
        raise InputError(f"a reference of kind '{entry.kind}' needs {missing[0]}; add it")
    surplus = [key for key in given if key not in (*needed, *allowed)]
    if surplus:
        raise InputError(f"a reference of kind '{entry.kind}' has no {surplus[0]}; remove it")
    return make(**given, folder=folder) if entry.kind == "trace" else make(**given)


def _from_trace(file: str, folder: pathlib.Path) -> AbstractSignal:
    trace = vgtjax.load_trace(folder / file, needs=("x_d",))
    return Sampled.through(trace.channels["x_d"].time - trace.time[0], trace.x_d)
