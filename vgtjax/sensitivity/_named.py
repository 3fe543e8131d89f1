"""Indices by the names of their outputs and inputs."""

import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from .._errors import InputError
from ..parameters import unknown_name
from ._resampling import BootstrapInterval

LARGEST = ("largest", "second", "third")
"""Inputs that are printed of an output."""


@dataclasses.dataclass(frozen=True, eq=False)
class NamedIntervals(BootstrapInterval):
    """One index of every output and input, `(outputs, inputs)`, or of every output, `(outputs,)`, read by name.

    `total["hysteresis_0mbar", "diaphragm.area"]` is that of one input, `total["hysteresis_0mbar"]` those of all. An
    output whose rows are called `name[0]`, `name[1]`, ... is a curve, and has an axis of points before that of inputs.
    """

    outputs: tuple[str, ...]
    inputs: tuple[str, ...]

    def __getitem__(self, names: str | tuple[str, str]) -> BootstrapInterval:
        """An index of one output, with the ends of its interval.

        **Raises:** `InputError` for a name that is none of the outputs, or of the inputs.
        """
        output, *chosen = (names,) if isinstance(names, str) else names
        rows = place_of("output", output, self.outputs)
        place = (rows, *(place_of("input", each, self.inputs) for each in chosen))
        return BootstrapInterval(*[np.asarray(end[place]) for end in (self.value, self.low, self.high)])


def place_of(kind: str, name: str, names: Sequence[str]) -> int | slice:
    """Where a name stands among others; all places of a curve, whose names are numbered.

    **Raises:** `InputError` where there is none.
    """
    if name in names:
        return names.index(name)
    points = [number for number, each in enumerate(names) if curve_of(each) == name]
    if not points:
        raise unknown_name(kind, name, list(dict.fromkeys([*names, *map(curve_of, names)])))
    return slice(points[0], points[-1] + 1)


def curve_of(name: str) -> str:
    """The curve that a numbered name is a point of, and any other name as it is."""
    return re.sub(r"\[\d+\]$", "", name)


def names_or_numbers(kind: str, names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """One name for each column; numbered ones where none are given.

    **Raises:** `InputError` when there is not one name per column, one is there twice, or those of a curve are apart.
    """
    found = tuple(f"{kind} {number}" for number in range(count)) if names is None else tuple(names)
    if len(found) != count:
        raise InputError(
            f"there must be a name for each of the {count} {kind}s, but there are {len(found)}; "
            "give one per column, in their order"
        )
    if len(set(found)) < count:
        twice = next(name for name in found if found.count(name) > 1)
        raise InputError(f"names must differ, but two {kind}s are called '{twice}'; give each its own name")
    curves = [curve for curve, _ in itertools.groupby(map(curve_of, found))]
    if len(set(curves)) < len(curves):
        apart = next(curve for curve in curves if curves.count(curve) > 1)
        raise InputError(f"numbered {kind}s must stand together, but those of '{apart}' do not; put them side by side")
    return found


def share(value: float) -> str:
    """A share of a variance as results print it; nothing for none."""
    return f"{value:.2f}" if np.isfinite(value) else ""


def largest(shares: Mapping[str, float]) -> list[str]:
    """The inputs with the largest shares of an output, as results print them."""
    known = sorted((name for name in shares if np.isfinite(shares[name])), key=lambda name: -shares[name])
    shown = [f"{name} {share(shares[name])}" for name in known[: len(LARGEST)]]
    return shown + [""] * (len(LARGEST) - len(shown))
