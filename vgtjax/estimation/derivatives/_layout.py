"""Which traces are laid out side by side, and in which shape: what decides how many programs are compiled."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..._lanes import fill_devices
from ...traces import Drive, Trace

SEGMENT = 50
"""Samples a segment of the parallel Jacobian: long enough that chaining segments costs little, short enough for many
lanes. Between 25 and 100 its time changes by a tenth."""

MOST_ROOM = 4
"""How many times as many lanes, and as many steps, one shape for all rates may have as their own, so that they share
it. What only fills up a shape is not simulated and has no tangents of its own: it takes memory, and steps in reverse
mode, while a program more compiles for some ten seconds. Of a slow loop beside 5 s at 1 kHz derivatives took 0.141 s
for 0.111, of other campaigns the same."""


class Layout(NamedTuple):
    """A trace to be laid out, and its inputs."""

    trace: Trace
    drive: Drive

    @property
    def segments(self) -> int:
        """Segments that it fills."""
        return -(-len(self.drive.duration) // SEGMENT)


Group = dict[int, Layout]
"""Traces that take the same steps an interval, by number."""


class Shape(NamedTuple):
    """What programs of a bundle are compiled for: segments of a trace, traces, and lanes."""

    segments: int
    traces: int
    lanes: int

    @staticmethod
    def of(group: Group) -> "Shape":
        """One of few, so that a trace that is a little longer needs no other programs."""
        segments = [each.segments for each in group.values()]
        return Shape(_round_up(max(segments)), len(group), fill_devices(_round_up(sum(segments))))

    @property
    def longest(self) -> int:
        """Samples of the longest trace that has room in it."""
        return SEGMENT * min(self.segments, self.lanes)

    def holds(self, group: Group) -> bool:
        """Whether these traces have room in it."""
        segments = [each.segments for each in group.values()]
        return len(group) <= self.traces and max(segments) <= self.segments and sum(segments) <= self.lanes


def packed(rates: Mapping[int, Group], shapes: Sequence[Shape]) -> list[tuple[int, Shape, Group]]:
    """Traces by the steps that they take an interval, in these shapes as far as they have room there, and the others
    in shapes of their own."""
    packs: list[tuple[int, Shape, Group]] = []
    rest: dict[int, Group] = {}
    for substeps, group in rates.items():
        mine: list[tuple[Shape, Group]] = []
        for index, layout in group.items():
            places = [*mine, *((shape, Group()) for shape in shapes)]
            place = next(((shape, pack) for shape, pack in places if shape.holds({**pack, index: layout})), None)
            if place is None:
                rest.setdefault(substeps, {})[index] = layout
                continue
            if not place[1]:
                mine.append(place)
            place[1][index] = layout
        packs += [(substeps, shape, pack) for shape, pack in mine]
    return packs + _own(rest)


def _own(rates: Mapping[int, Group]) -> list[tuple[int, Shape, Group]]:
    """One shape for all rates, so that they share programs, unless that takes too much room."""
    own = {substeps: Shape.of(group) for substeps, group in rates.items()}
    if not own:
        return []
    common = Shape(*(max(sizes) for sizes in zip(*own.values(), strict=True)))
    lanes = len(own) * common.lanes, sum(shape.lanes for shape in own.values())
    steps = sum(own) * common.segments, sum(substeps * shape.segments for substeps, shape in own.items())
    alike = all(together <= MOST_ROOM * apart for together, apart in (lanes, steps))
    return [(substeps, common if alike else own[substeps], group) for substeps, group in rates.items()]


def _round_up(count: int) -> int:
    """The next number with five binary digits before its zeros: a sixteenth more at most, and few sizes."""
    unit = 2 ** max(count.bit_length() - 5, 0)
    return -(-count // unit) * unit
