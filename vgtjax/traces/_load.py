"""Reading a bench trace from a file, and saying precisely what is wrong with one.

The rules are strict on purpose: a trace that is misread calibrates an actuator to nonsense.
"""

import contextlib
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ._assignment import Assigned, Assignment
from ._channel import GAP, Channel, Samples
from ._checks import TRAVEL, check_finite, check_gaps, check_numbers, check_range, ends_of
from ._clocks import Clocks
from ._no_measurements import at_ends_of_range, repeated
from ._signals import SIGNALS
from ._source import Sources
from ._trace import ASSUMED_RESERVOIR, STANDARD_ATMOSPHERE, Trace
from .files import Record, Recording, open_recording

SHARED = 0.9
"""Part of a channel below which it is noted that others were not recorded at the same time."""


def load_trace(
    path: str | os.PathLike[str],
    *,
    channels: Sources | None = None,
    atmosphere: float = STANDARD_ATMOSPHERE,
    travel: float = TRAVEL,
    needs: Sequence[str] = (),
    ignore: Sequence[str] = (),
    name: str | None = None,
) -> Trace:
    """Reads a bench trace: CSV, MDF, TDMS, MATLAB or Parquet by the suffix of the file.

    Channels are called `name [unit]`, or `name` with a unit that the file states beside it; `channels` maps others.
    They keep the clocks of the file. The manual (`docs/files.md`) says what each kind of file may look like.

    **Arguments:**

    - `channels`: where signals are, by signal, if not under their own names: a [`Source`][] each.
    - `atmosphere`: Pa; added to gauge pressures.
    - `travel`: m; a position beyond it, or a pressure outside vacuum and atmosphere, is refused unless it is
      within what sensors are off by. With a measured `f_drive` any position goes.
    - `needs`: signals that must be present, alternatives joined by `|`.
    - `ignore`: signals that the model at hand has no use for.
    - `name`: of the trace; the file's stem by default.

    **Returns:** a [`Trace`][] in SI units; its `notes` say what was assumed or ignored.

    **Raises:** `InputError` with file, line (the header is 1) or sample, column or channel, and remedy.
    """
    path = pathlib.Path(path)
    with contextlib.closing(open_recording(path)) as recording:
        assignment = Assignment(recording, channels or {}, ignore)
        for need in needs:
            assignment.require(need)
        records = {signal: _read(recording, assigned) for signal, assigned in assignment.found.items()}
        clocks = Clocks(recording, assignment, records)
    ends = ends_of(atmosphere, travel)
    if "f_drive" in records:
        del ends["x_d"]  # a rig that is driven by a force need not be this actuator
    signals: dict[str, Any] = {}
    notes = assignment.notes
    for signal, assigned in assignment.found.items():
        valid = _valid(records[signal])
        values = _to_si(recording, assigned, records[signal], clocks.rows[signal], atmosphere, ends.get(signal))
        if not np.all(valid):
            notes.append(
                f"{recording.noun} '{assigned.entry.label}': {np.sum(~valid)} samples are marked as invalid and skipped"
            )
            if SIGNALS[signal].role == "input":  # a model can't be driven by what nobody knows
                check_gaps(recording, assigned.entry, clocks.time[signal][valid], clocks.rows[signal][valid])
        if SIGNALS[signal].role == "measured":
            valid, said = _measurements(values, valid)
            notes += [f"{recording.noun} '{assigned.entry.label}': {sentence}" for sentence in said]
        signals[signal] = Channel(clocks.time[signal], values, valid)
    # Without a duty nothing flows to a reservoir.
    if "pwm" in signals and not {"p_res", "f_drive"} & signals.keys():
        notes.append(f"no {recording.noun} p_res; {ASSUMED_RESERVOIR:.0f} Pa absolute is assumed for the reservoir")
    found = Trace(clocks.alone, **signals, atmosphere=atmosphere, name=path.stem if name is None else name)
    trace = _while_driven(found)
    return trace.replace(notes=(*notes, *_unshared(trace, clocks.time)))


def _read(recording: Recording, assigned: Assigned) -> Record:
    record = recording.read(assigned.entry)
    check_numbers(recording, assigned.entry, record.value)
    if not np.any(_valid(record)):
        what = f"none of its {len(record.value)} samples is valid"
        raise recording.fail(what, f"leave it out by mapping channels.{assigned.signal} to another", assigned.entry)
    return record


def _valid(record: Record) -> np.ndarray:
    return np.ones(len(record.value), dtype=bool) if record.valid is None else record.valid


def _measurements(values: Samples, valid: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Which samples are valid and say what a sensor measured, and a note on those that are valid only."""
    notes = []
    again = np.zeros(len(values), dtype=bool)
    if np.all(valid):
        again = repeated(values)
    if np.any(again):
        left = np.sum(~again)
        notes.append(f"each value stands for several samples, so only the first counts: {left} of {len(values)}")
        valid = valid & ~again
    beyond = np.zeros(len(values), dtype=bool)
    beyond[valid] = at_ends_of_range(values[valid])
    if np.any(beyond):
        said = f"{np.sum(beyond)} of {len(values)} samples are at an end of what their sensor shows, and skipped"
        notes.append(f"{said}; use one with a wider range")
    return valid & ~beyond, notes


def _to_si(
    recording: Recording,
    assigned: Assigned,
    record: Record,
    rows: np.ndarray,
    atmosphere: float,
    ends: tuple[float, float] | None,
) -> Samples:
    """Checked values of a signal, those of invalid samples being anything."""
    raw, valid = assigned.source.apply(record.value), _valid(record)
    check_finite(recording, assigned.entry, raw, valid, rows)
    values = assigned.unit.to_si(raw, atmosphere)
    if ends is not None:
        check_range(recording, assigned, raw[valid], values[valid], rows[valid], ends)
    return values


def _while_driven(trace: Trace) -> Trace:
    """The part of a trace in which all of its inputs are known."""
    begin, end = trace.time[0], trace.time[-1]
    for name, channel in trace.channels.items():
        if SIGNALS[name].role == "input":
            # Nobody knows the duty after its record, which ends a step or two before others where it has fewer samples.
            steps = np.diff(channel.time) if SIGNALS[name].held else np.zeros(0)
            beyond = GAP * float(np.median(steps)) if len(steps) else 0.0
            begin, end = max(begin, channel.time[0]), min(end, channel.time[-1] + beyond)
    whole = (begin, end) == (trace.time[0], trace.time[-1])
    return trace if whole else trace.window(begin, end)


def _unshared(trace: Trace, times: Mapping[str, Samples]) -> list[str]:
    """A note for every channel of which a good part lies outside the time that all of them share; `times` of its
    samples by name, those of invalid ones as well."""
    notes = []
    for signal, time in times.items():
        shared, span = trace.time[-1] - trace.time[0], time[-1] - time[0]
        if shared < SHARED * span:
            notes.append(f"of {span:g} s of {signal} only {shared:g} s are in the time that all channels share")
    return notes
