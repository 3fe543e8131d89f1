"""MDF 3 and 4, which INCA, CANape and most loggers of vehicles write; read by asammdf."""

import contextlib
import pathlib
import traceback
from typing import Any, BinaryIO

import numpy as np

from ._recording import Entry, Record, Recording, load_package, reading, require_start

TIME = 1
"""The kind of master that is a time; others are angles, distances and record numbers (MDF 4, `cn_sync_type`)."""


class MDFRecording(Recording):
    """Groups of channels, each with a master channel that has its times."""

    def __init__(self, path: pathlib.Path):
        self.path = path
        require_start(path, (b"MDF ", b"UnFinMF "), "MDF")
        asammdf = load_package(path, "asammdf", "mdf")
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            with reading(path, "MDF"):
                self._file: Any = _open(asammdf, file)
                stack.callback(self._file.close)
                self.entries = [entry for index in range(len(self._file.groups)) for entry in self._list(index)]
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Closes the file."""
        self._stack.close()

    def read(self, entry: Entry) -> Record:
        """The samples of a channel in its physical unit, those marked as invalid too, and the times of its master."""
        group, index = entry.key
        self._require_time(entry, group)
        with reading(self.path, "MDF"):
            self._require_inside(group, index)
            signal = self._file.get(group=group, index=index, ignore_invalidation_bits=True)
        bits = signal.invalidation_bits
        time = np.asarray(signal.timestamps) * self._seconds(entry, group)
        cycles = self._file.groups[group].channel_group.cycles_nr
        # Some versions of asammdf returned other times than those of the samples.
        if not len(signal.samples) == len(time) == cycles:
            raise self.fail(
                f"a channel must have one sample per time and record, but it has {len(signal.samples)} samples, "
                f"{len(time)} times and {cycles} records",
                "export the trace again",
                entry,
            )
        return Record(np.asarray(signal.samples), time, None if bits is None else ~np.asarray(bits, dtype=bool))

    def _list(self, group: int) -> list[Entry]:
        master = self._file.masters_db.get(group)
        channels = self._file.groups[group].channels
        return [
            Entry(
                channel.name,
                self._file.get_channel_unit(group=group, index=index) or None,
                group=str(group),
                timed=True,
                key=(group, index),
            )
            for index, channel in enumerate(channels)
            if index != master
        ]

    def _master(self, group: int) -> Any:
        """The channel with the times of a group, which may stand in another one; `None` without one."""
        master = self._file.masters_db.get(group)
        if master is not None:
            return self._file.groups[group].channels[master]
        other = getattr(self._file.groups[group].channel_group, "cg_master_index", None)
        return None if other is None else self._master(other)

    def _require_time(self, entry: Entry, group: int) -> None:
        master = self._master(group)
        if master is None or getattr(master, "sync_type", TIME) != TIME:  # MDF 3 knows no others
            found = "has no master channel" if master is None else f"is recorded over '{master.name}'"
            raise self.fail(f"a group must have times, but this one {found}", "record it over time", entry)

    def _require_inside(self, group: int, index: int) -> None:
        """Refuses a channel, or times, that lie outside of their record, which asammdf reads all the same."""
        for place, which in ((group, index), (group, self._file.masters_db.get(group, index))):
            head, channel = self._file.groups[place].channel_group, self._file.groups[place].channels[which]
            if hasattr(channel, "byte_offset"):
                begin, bits = channel.byte_offset, channel.bit_offset + channel.bit_count
            else:  # MDF 3
                begin, bit = divmod(channel.start_offset, 8)
                begin, bits = begin + getattr(channel, "additional_byte_offset", 0), bit + channel.bit_count
            size = head.samples_byte_nr + getattr(head, "invalidation_bytes_nr", 0)
            if begin + -(-bits // 8) > size:
                raise ValueError(f"'{channel.name}' lies outside of its record of {size} bytes")

    def _seconds(self, entry: Entry, group: int) -> float:
        """Factor from the times of a group to seconds, which is what the format asks for."""
        unit = getattr(self._master(group), "unit", "") or "s"
        if unit not in ("s", "ms"):
            raise self.fail(f"times must be in s or ms, but here they are in '{unit}'", "convert them", entry)
        return 1e-3 if unit == "ms" else 1.0


def _open(asammdf: Any, file: BinaryIO) -> Any:
    """The file as asammdf reads it.

    Of a broken file it leaves a reader half made, whose destructor fails, which Python would print whenever it is
    collected. With what that deletes it can be closed here.
    """
    try:
        return asammdf.MDF(file)
    except Exception as error:
        frames = [frame.f_locals for frame, _ in traceback.walk_tb(error.__traceback__)]
        for reader in (names["self"] for names in frames if hasattr(names.get("self"), "_closed")):
            vars(reader).setdefault("header", None)
            vars(reader).setdefault("identification", None)
            reader.close()
        raise
