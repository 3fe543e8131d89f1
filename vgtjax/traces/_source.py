"""Where a signal is in a file whose names are not ours."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from .._errors import InputError
from ._channel import Samples
from ._names import nearest
from ._units import UNITS


@dataclasses.dataclass(frozen=True)
class Source:
    """Where a signal is in a file, and what its numbers mean: `value = raw * scale + offset`, in `unit`.

    **Arguments:**

    - `name`: of the channel, with or without a unit in brackets; the signal's own name by default.
    - `unit`: e.g. `mbar gauge`; by default what the file says.
    - `group`: where names are not unique: index of an MDF group, name of a TDMS group, path of a MATLAB struct.
    - `time`: the channel with its times, where a file has them as channels; by default what `time` is mapped to.
    """

    name: str | None = None
    unit: str | None = None
    group: str | int | None = None
    scale: float = 1.0
    offset: float = 0.0
    time: str | None = None

    @property
    def is_scaled(self) -> bool:
        """Whether numbers are not taken as they are."""
        return (self.scale, self.offset) != (1.0, 0.0)

    def apply(self, raw: np.ndarray) -> Samples:
        """Numbers of a file in `unit`."""
        values = raw.astype(np.float64)
        return values * self.scale + self.offset if self.is_scaled else values


Sources = Mapping[str, Source]
"""By signal; `time` is one of them."""


def require_known(sources: Sources) -> None:
    """Refuses the map of what is no signal of a file.

    **Raises:** `InputError`.
    """
    for signal in sources:
        if signal not in UNITS:
            raise InputError(
                f"channels must be of the signals {', '.join(UNITS)}, but there is '{signal}'; did you mean "
                f"'{nearest(signal, UNITS)[0]}'?",
                "channels",
            )
