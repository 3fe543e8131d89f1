"""`[channels]`: where the signals are in files whose names are not ours."""

from typing import Literal

import pydantic

from vgtjax.traces import Source

from .base import Finite, Table

ChannelName = Literal["time", "pwm", "p_act", "p_res", "p_trb", "x_d", "f_vane", "f_drive"]


class ChannelTable(Table):
    """One channel: `raw * scale + offset` is its value in `unit`; see [`vgtjax.traces.Source`][]."""

    name: str | None = None
    """What the file calls it; else the name of the signal."""
    unit: str | None = None
    """One of ours; else what the file says."""
    group: int | str | None = None
    """Which of several channels of that name: index or name of its group."""
    scale: Finite = 1.0
    """The value is the raw one times this, plus `offset`; not zero."""
    offset: Finite = 0.0
    """In `unit`."""
    time: str | None = None
    """The channel with its times, where times are channels."""

    @pydantic.field_validator("scale")
    @classmethod
    def _not_zero(cls, scale: float) -> float:
        if scale == 0:
            raise ValueError("the scale of a channel must not be zero, but it is; remove it or correct it")
        return scale


Channels = dict[ChannelName, ChannelTable]


def sources_of(channels: Channels) -> dict[str, Source]:
    """The same for the library."""
    return {name: Source(**dict(table)) for name, table in channels.items()}
