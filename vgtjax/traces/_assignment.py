"""Which channel of a file is which signal: by its own name, or as it is mapped."""

import dataclasses
import re
from collections.abc import Sequence

from .._errors import InputError
from ._names import distance_at_most, nearest
from ._signals import SIGNALS
from ._source import Source, Sources, require_known
from ._units import UNITS, Unit, example, parse_unit
from .files import Entry, Recording

SIMULATED_ONLY = {name for name, signal in SIGNALS.items() if signal.role == "state"}
"""Channels that a simulation writes and that are no input: ignored, not misspelt."""
NAMED = 10
"""So many unused channels are noted by name; of more, how many they are."""


@dataclasses.dataclass(frozen=True)
class Assigned:
    """A channel that is a signal, and the one that has its times; `None` where the file itself knows them."""

    signal: str
    entry: Entry
    unit: Unit
    source: Source
    clock: "Assigned | None" = None


class Assignment:
    """The signals of a file: `found` by name, in its order, and `time` where the file has nothing but times.

    **Raises:** `InputError` when a mapped channel is missing, names are not unique or nearly right, or a unit is.
    """

    found: dict[str, Assigned]
    time: Assigned | None

    def __init__(self, recording: Recording, sources: Sources, ignore: Sequence[str]):
        require_known(sources)
        self._recording = recording
        self._sources = {signal: source for signal, source in sources.items() if signal not in ignore}
        self._ignore = ignore
        if not sources:  # names of a file that is mapped are not ours
            for entry in recording.entries:
                self._refuse_nearly_right(entry)
        assigned = [self._assign(*found) for found in self._entries()]
        self.found = {each.signal: self._with_clock(each) for each in assigned}
        untimed = not self.found and not any(entry.timed for entry in recording.entries)
        self.time = self._clock(Entry(""), Source()) if untimed else None

    def require(self, need: str) -> None:
        """Refuses a file without a signal that is needed; alternatives are joined by `|`.

        **Raises:** `InputError` that names the channels of the file which come nearest.
        """
        signals = need.split("|")
        if not any(signal in self.found for signal in signals):
            raise self._missing(signals, " or ".join(signals))

    @property
    def notes(self) -> list[str]:
        """What is not used."""
        used = {each.entry for assigned in self.found.values() for each in (assigned, assigned.clock or assigned)}
        used |= {self.time.entry} if self.time else set()
        names = [entry.label for entry in self._recording.entries if entry not in used]
        noun = self._recording.noun
        if len(names) > NAMED:
            return [f"{len(names)} {noun}s of the file are not used"]
        return [f"{noun} '{name}' is not used" if name else f"a {noun} without a name is not used" for name in names]

    def _source(self, signal: str) -> Source:
        return self._sources.get(signal, Source())

    def _entries(self) -> list[tuple[str, Entry, Source]]:
        """Every signal that is there, its channel and what is known of that, in the order of the file."""
        found = []
        for signal in UNITS:
            if signal != "time" and signal not in self._ignore:
                source = self._source(signal)
                matching, source = self._matching(signal, source, source.group)
                if len(matching) > 1:
                    raise self._ambiguous(signal, matching)
                if matching:
                    found.append((signal, matching[0], source))
                elif (source.name, source.group) != (None, None):
                    raise self._missing([signal], source.name or signal, source.group)
        order = {entry: place for place, entry in enumerate(self._recording.entries)}
        return sorted(found, key=lambda each: order[each[1]])

    def _matching(self, signal: str, source: Source, group: str | int | None) -> tuple[list[Entry], Source]:
        """Channels of a group that a map means, or else those in our own form, which need no map."""
        mapped = self._named(source.name or signal, group)
        ours = [] if mapped or source.name is None else self._named(signal, group)
        stated = [entry for entry in ours if (entry.stated_unit or entry.usual_unit) is not None]
        return (stated, Source()) if stated else (mapped, source)

    def _named(self, name: str, group: str | int | None) -> list[Entry]:
        entries = [entry for entry in self._recording.entries if group is None or entry.group == str(group)]
        return [entry for entry in entries if entry.name == name] or [e for e in entries if e.label == name]

    def _assign(self, signal: str, entry: Entry, source: Source) -> Assigned:
        stated = entry.stated_unit
        mapped = source != Source() or not self._recording.is_text

        def fail(what: str, remedy: str) -> InputError:
            return self._recording.fail(what, remedy, entry)

        def write(*units: str) -> str:
            if mapped:
                return " or ".join(f"unit = '{unit}'" for unit in units) + f" in channels.{signal}"
            return " or ".join(f"'{signal} [{unit}]'" for unit in units)

        text = (entry.usual_unit if stated is None else stated) if source.unit is None else source.unit
        if text is None or not text.strip():
            raise fail("the unit is missing", f"write e.g. {write(example(signal))}" + " in the header" * (not mapped))
        unit = parse_unit(signal, text, fail, write)
        if source.unit is not None and not source.is_scaled and _contradicts(stated, unit):
            raise fail(
                f"the file says that its unit is '{stated}', but channels.{signal} says '{unit}'",
                "correct the unit, or state the scale between them",
            )
        return Assigned(signal, entry, unit, source)

    def _with_clock(self, assigned: Assigned) -> Assigned:
        if assigned.entry.timed:
            return assigned
        return dataclasses.replace(assigned, clock=self._clock(assigned.entry, assigned.source))

    def _clock(self, entry: Entry, source: Source) -> Assigned:
        """The channel with the times of another: in the same group, or in one around it."""
        mapped = self._source("time")
        parts = entry.group.split(".")
        around: list[str | int] = [".".join(parts[:length]) for length in range(len(parts), -1, -1)]
        for group in around if mapped.group is None or source.time is not None else [mapped.group]:
            if source.time is None:
                matching, mine = self._matching("time", mapped, group)
            else:
                matching, mine = self._named(source.time, group), mapped
            if len(matching) > 1:
                raise self._ambiguous("time", matching)
            if matching:
                return self._assign("time", matching[0], mine)
        raise self._missing(["time"], source.time or mapped.name or "time")

    def _missing(self, signals: Sequence[str], name: str, group: str | int | None = None) -> InputError:
        recording, either = self._recording, " or ".join(signals)
        if recording.is_text and not self._sources:
            wanted = " or ".join(f"'{signal} [{example(signal)}]'" for signal in signals)
            remedy = f"add a column {wanted}, or state in channels which column is which"
            return recording.fail("the column is missing", remedy, either)
        where = "" if group is None else f" in group {group}"
        near = [f"'{found}'" for found in nearest(name, (entry.label for entry in recording.entries), 3)]
        remedy = f"name it in {' or '.join(f'channels.{signal}' for signal in signals)}"
        known = f", the nearest names are {', '.join(near)}" if near else ""
        return recording.fail(f"no {recording.noun} is called {name}{where}", remedy + known, either)

    def _ambiguous(self, signal: str, matching: Sequence[Entry]) -> InputError:
        groups = list(dict.fromkeys(entry.group for entry in matching))
        if len(groups) < len(matching):
            return self._recording.fail(
                f"the {self._recording.noun} appears twice", "remove or rename one of them", matching[0]
            )
        return self._recording.fail(
            f"a name must be unique, but '{matching[0].label}' is in the groups {', '.join(groups)}",
            f"state which with group in channels.{signal}",
            signal,
        )

    def _refuse_nearly_right(self, entry: Entry) -> None:
        recording, name = self._recording, entry.label
        listed = re.split(r"\W", name, maxsplit=1)[0]
        if listed in UNITS and name != listed and listed not in self._ignore:
            written = f"write e.g. '{listed} [{example(listed)}]'"
            if re.search(r"[\[\]]", name):
                raise recording.fail(f"the header '{name}' must read 'name [unit]'", written, entry)
            if entry.stated_unit is None:
                raise recording.fail(f"the header '{name}' has no unit in brackets", written, listed)
        near = [known for known in UNITS if distance_at_most(name.casefold(), known, 2)]
        if near and name not in UNITS and name not in SIMULATED_ONLY:
            best = nearest(name, near)[0]
            raise recording.fail(
                f"the name '{name}' looks like a misspelt '{best}'",
                f"write '{best}', or state in channels which {recording.noun} is which",
                entry,
            )


def _contradicts(stated: str | None, unit: Unit) -> bool:
    """Whether a file states another one of the units that its signal may have; others are a logger's own words."""
    symbol, *reference = (stated or "").split() or [""]
    return symbol in UNITS[unit.signal] and (symbol != unit.symbol or reference not in ([], [unit.reference]))
