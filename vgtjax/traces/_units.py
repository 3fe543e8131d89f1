"""The units that a file's signals may have, and how they become SI."""

import dataclasses
from collections.abc import Callable

import numpy as np

from .._errors import InputError
from ._channel import Samples

bar, kilo, milli, micro = 1e5, 1e3, 1e-3, 1e-6  # to import SciPy for them takes a tenth of a second
PRESSURES = ("p_act", "p_res", "p_trb")
PRESSURE_UNITS = {"Pa": 1.0, "kPa": kilo, "mbar": milli * bar, "bar": bar}
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": milli},
    "pwm": {"%": 1.0, "1": 100.0},
    "p_act": PRESSURE_UNITS,
    "p_res": PRESSURE_UNITS,
    "p_trb": PRESSURE_UNITS,
    "x_d": {"m": 1.0, "mm": milli, "um": micro},
    "f_vane": {"N": 1.0},
    "f_drive": {"N": 1.0},
}
"""The units that each signal of a file may have, and their factors to SI (duty: to %); pressures are followed by
`gauge` or `absolute`."""


@dataclasses.dataclass(frozen=True)
class Unit:
    """The unit of a signal, e.g. `mbar gauge`; `reference` is blank but for pressures."""

    signal: str
    symbol: str
    reference: str = ""

    def __str__(self) -> str:
        return f"{self.symbol} {self.reference}".rstrip()

    def to_si(self, values: Samples, atmosphere: float) -> Samples:
        """Values in SI; pressures absolute, but that of the turbine gauge; `atmosphere` in Pa."""
        with np.errstate(over="ignore"):  # of a broken file; what is infinite is out of range
            converted = values * UNITS[self.signal][self.symbol]
        if self.signal == "p_trb":
            return converted - atmosphere if self.reference == "absolute" else converted
        return converted + atmosphere if self.reference == "gauge" else converted


def parse_unit(signal: str, text: str, fail: Callable[[str, str], InputError], write: Callable[..., str]) -> Unit:
    """A unit as a file or a map says it.

    **Arguments:** `fail`: makes an error of what is wrong and its remedy; `write`: how units are stated there.

    **Raises:** what `fail` made, when the unit is not known, or a pressure neither gauge nor absolute.
    """
    symbol, *reference = text.split()
    if symbol not in UNITS[signal] or (reference and signal not in PRESSURES) or len(reference) > 1:
        either = ", each followed by gauge or absolute" if signal in PRESSURES else ""
        raise fail(f"the unit '{text}' is not known here", f"use one of {', '.join(UNITS[signal])}{either}")
    if signal in PRESSURES and reference not in (["gauge"], ["absolute"]):
        raise fail(
            f"a pressure must be gauge or absolute, but its unit is '{text}'",
            f"write {write(f'{symbol} gauge', f'{symbol} absolute')}",
        )
    return Unit(signal, symbol, "".join(reference))


def example(signal: str) -> str:
    """A unit that is right."""
    return "mbar gauge" if signal in PRESSURES else "mm" if signal == "x_d" else next(iter(UNITS[signal]))
