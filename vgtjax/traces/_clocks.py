"""The times of a file's channels: read once each, checked, and in seconds."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from ._assignment import Assigned, Assignment
from ._channel import Samples
from ._checks import check_finite, check_gaps, check_increasing, check_numbers, check_rate
from .files import Entry, Record, Recording

Numbers = np.ndarray


@dataclasses.dataclass(frozen=True)
class _Clock:
    """Times in the unit of the file, and in s."""

    stated: Samples
    seconds: Samples


class Clocks:
    """By signal, the `time` of its samples in s and their `rows` in the file.

    `alone` are the times of a file without signals. Dates become seconds since the first one of any channel.

    **Raises:** `InputError` when times are no numbers, not as many as samples, don't increase, have gaps, or imply a
    rate that can't be.
    """

    time: dict[str, Samples]
    rows: dict[str, Numbers]
    alone: Samples | None

    def __init__(self, recording: Recording, assignment: Assignment, records: Mapping[str, Record]):
        self._recording = recording
        stated: dict[Entry, Numbers] = {}
        clocks: dict[Entry, Assigned] = {}
        for signal, assigned in assignment.found.items():
            time = records[signal].time
            if assigned.clock is None:
                assert time is not None, "the reader called the entry timed"
                stated[assigned.entry] = time
            else:
                clocks[assigned.clock.entry] = assigned.clock
        if assignment.time is not None:
            clocks[assignment.time.entry] = assignment.time
        stated |= {entry: self._complete(entry) for entry in clocks}
        numbers = self._as_numbers(stated)
        found = {entry: self._clock(entry, times, clocks.get(entry)) for entry, times in numbers.items()}
        self.time, self.rows = {}, {}
        for signal, assigned in assignment.found.items():
            self._add(assigned, records[signal], found[_holder(assigned)])
        self.alone = None if assignment.time is None else found[assignment.time.entry].seconds

    def _complete(self, entry: Entry) -> Numbers:
        """The times of a channel of times; samples are counted by them, so that none may be missing."""
        record = self._recording.read(entry)
        if record.rows is not None:
            at = int(np.flatnonzero(np.append(record.rows, -1) != np.arange(len(record.rows) + 1))[0])
            raise self._recording.fail("every time must be there, but this one is missing", "remove the row", entry, at)
        return record.value

    def _as_numbers(self, stated: Mapping[Entry, Numbers]) -> dict[Entry, Numbers]:
        """Times as numbers: durations in s, dates in s since the first of all."""
        for entry, times in stated.items():
            check_numbers(self._recording, entry, times, "fiumM")
            check_finite(self._recording, entry, times, np.ones(len(times), dtype=bool))
        dated = [entry for entry, times in stated.items() if times.dtype.kind == "M"]
        if dated and len(dated) < len(stated):
            other = next(entry for entry in stated if entry not in dated)
            what = (
                f"times must be dates or numbers throughout, but here they are numbers, and those of {dated[0].label}"
            )
            raise self._recording.fail(f"{what} are dates", "export the trace with one kind of time", other)
        begin = min((np.min(stated[entry]) for entry in dated), default=None)
        since = {entry: times if begin is None else times - begin for entry, times in stated.items()}
        second = np.timedelta64(1, "s")
        return {entry: times / second if times.dtype.kind == "m" else times for entry, times in since.items()}

    def _clock(self, entry: Entry, times: Numbers, assigned: Assigned | None) -> _Clock:
        """Times of one entry; `assigned` where it is a channel of times, which has a unit."""
        times = times.astype(np.float64)
        if assigned is None:
            stated = seconds = times
        else:
            stated = assigned.source.apply(times)
            seconds = assigned.unit.to_si(stated, 0.0)
        check_increasing(self._recording, entry, stated)
        return _Clock(stated, seconds)

    def _add(self, assigned: Assigned, record: Record, clock: _Clock) -> None:
        """The times of one signal."""
        signal, entry, count = assigned.signal, assigned.entry, len(clock.stated)
        every = np.arange(count)
        rows = every if record.rows is None else record.rows
        if len(rows) != len(record.value):
            raise self._recording.fail(
                f"a channel must have one sample per time, but it has {len(record.value)} samples and {count} times",
                f"name the channel with its times by time in channels.{signal}",
                entry,
            )
        holder = _holder(assigned) if record.rows is None else entry
        stated = clock.stated if record.rows is None else clock.stated[rows]
        self.time[signal] = clock.seconds if record.rows is None else clock.seconds[rows]
        self.rows[signal] = rows
        check_gaps(self._recording, holder, stated, rows)
        check_rate(self._recording, holder, self.time[signal])


def _holder(assigned: Assigned) -> Entry:
    """The entry that has the times of a signal."""
    return assigned.entry if assigned.clock is None else assigned.clock.entry
