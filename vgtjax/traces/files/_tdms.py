"""TDMS, which LabVIEW writes; read by npTDMS."""

import contextlib
import pathlib
from typing import Any

import numpy as np

from ._recording import Entry, Record, Recording, load_package, reading, require_start

UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription")
"""Where LabVIEW and DAQmx write the unit of a channel."""


class TDMSRecording(Recording):
    """Groups of channels: waveforms with the properties of their clock, or columns with a channel of times."""

    def __init__(self, path: pathlib.Path):
        self.path = path
        require_start(path, (b"TDSm",), "TDMS")
        nptdms = load_package(path, "nptdms", "tdms")
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            with reading(path, "TDMS"):
                self._file: Any = nptdms.TdmsFile.open(file)
                incomplete = self._file.file_status.incomplete_final_segment
                channels = [channel for group in self._file.groups() for channel in group.channels()]
            if incomplete:
                raise self.fail("the file ends before its last segment does", "export the trace again")
            self._origin = min(starts) if (starts := list(filter(None, map(_start, channels)))) else None
            self.entries = [self._entry(channel) for channel in channels]
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Closes the file."""
        self._stack.close()

    def read(self, entry: Entry) -> Record:
        """The scaled samples of a channel; those of a waveform with times, in s since the first waveform began."""
        group, name = entry.key
        channel = self._file[group][name]
        with reading(self.path, "TDMS"):
            values = np.asarray(channel[:])
        if not entry.timed:
            return Record(values)
        properties = channel.properties
        started = _start(channel)
        since = 0.0 if started is None else float(np.timedelta64(started - self._origin, "us").astype(float)) * 1e-6
        begin = since + properties.get("wf_start_offset", 0.0)
        return Record(values, begin + np.arange(len(values)) * properties["wf_increment"])

    def _entry(self, channel: Any) -> Entry:
        properties = channel.properties
        unit = next((properties[key] for key in UNIT_PROPERTIES if properties.get(key)), None)
        if channel.dtype.kind == "M":
            unit = "s"  # dates, which become seconds
        timed = properties.get("wf_increment", 0.0) > 0  # zero is what LabVIEW writes where it knows none
        return Entry(channel.name, unit, channel.group_name, timed, (channel.group_name, channel.name))


def _start(channel: Any) -> np.datetime64 | None:
    """When a waveform began, where it says so."""
    start = channel.properties.get("wf_start_time")
    return start if isinstance(start, np.datetime64) and channel.properties.get("wf_increment", 0.0) > 0 else None
