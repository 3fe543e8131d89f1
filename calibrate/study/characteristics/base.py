"""What CDFX and DCM files have in common: named values, blocks, axes and maps, and where they come from."""

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

TOOL = "vgtjax"
DERIVED = "derived."
"""How names begin of what follows from parameters: it is written for readers, and not read back."""
UNENDING = sys.float_info.max
"""What stands for infinity, which these files don't have: a `diaphragm.travel` without end."""
Category = Literal["VALUE", "VAL_BLK", "COM_AXIS", "CURVE", "MAP"]


def identifier(name: str) -> str:
    """A parameter or an entry as a name that control units allow: `__` for a dot, `__2` for `[2]`.

    No parameter has two underscores in a row, so the way back is clear.
    """
    return name.replace("[", ".").removesuffix("]").replace(".", "__")


def parameter_name(identifier: str) -> str:
    """The way back from [`identifier`][]."""
    *path, last = identifier.split("__")
    return f"{'.'.join(path)}[{last}]" if path and last.isdecimal() else ".".join([*path, last])


def number(value: float) -> str:
    """The shortest text that reads back as the same double."""
    return repr(min(max(float(value), -UNENDING), UNENDING))


@dataclasses.dataclass(frozen=True, eq=False)
class Characteristic:
    """A parameter, or an entry of one whose entries have units of their own.

    `values` is a number, a block, an axis' knots, a curve, or a map with a row for each knot of its first axis; `axes`
    are the names of a curve's or a map's axes, `state` and `remarks` what is said of it in its history.
    """

    name: str
    long_name: str
    unit: str
    values: Float[np.ndarray, "..."]
    axes: tuple[str, ...] = ()
    is_axis: bool = False
    state: str = "calibrated"
    remarks: tuple[str, ...] = ()

    @property
    def category(self) -> Category:
        """As CDFX calls it."""
        if self.is_axis:
            return "COM_AXIS"
        if self.axes:
            return "CURVE" if len(self.axes) == 1 else "MAP"
        return "VAL_BLK" if np.ndim(self.values) else "VALUE"


@dataclasses.dataclass(frozen=True, eq=False)
class DataSet:
    """The parameters of one actuator, and where they come from.

    `model` and `components` are as a study states them, `hashes` the SHA-256 of the traces by their names.
    """

    version: str
    date: str
    model: str
    components: Mapping[str, str]
    hashes: Mapping[str, str]
    characteristics: Sequence[Characteristic]

    @property
    def model_text(self) -> str:
        """Model and components in one line of these files."""
        return " ".join(f"{key}={name}" for key, name in {"model": self.model, **self.components}.items())

    def named(self, name: str) -> Characteristic:
        """The characteristic of that name."""
        return next(each for each in self.characteristics if each.name == name)


@dataclasses.dataclass(frozen=True)
class Found:
    """What a file holds under a name, as it stands there."""

    identifier: str
    values: list[str]
    is_number: bool
    """Whether there is one value and no list of them."""
    unit: str | None
