"""How outputs are shown: in the units of the bench."""

import dataclasses

from vgtjax.experiments import Output


@dataclasses.dataclass(frozen=True)
class Scaled:
    """The units in which an output is shown, and the factors to them from SI."""

    unit: str
    factor: float
    axis_unit: str
    axis_factor: float


_SHOWN = {"Pa": ("mbar", 1e-2), "s": ("ms", 1e3), "m": ("mm", 1e3), "": ("", 1.0)}


def scaled(output: Output) -> Scaled:
    """The units of the bench: mbar, ms, mm."""
    axis = ("s", 1.0) if output.axis_unit == "s" else _SHOWN[output.axis_unit]
    return Scaled(*_SHOWN[output.unit], *axis)
