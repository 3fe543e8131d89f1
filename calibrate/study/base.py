"""What all tables of a study share, and the numbers that stand in them."""

import datetime
from collections.abc import Mapping
from typing import Annotated, Literal, TypeVar

import pydantic


class Table(pydantic.BaseModel):
    """What all tables share: no unknown keys, no conversions, no changes."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, strict=True)


Key = TypeVar("Key", bound=str)
SomeTable = TypeVar("SomeTable", bound=Table)


def override(general: Mapping[Key, SomeTable], own: Mapping[Key, SomeTable]) -> dict[Key, SomeTable]:
    """Tables by name, those in general key by key overridden by others."""
    merged = dict(general)
    for name, table in own.items():
        stated = table.model_dump(exclude_unset=True)
        merged[name] = merged[name].model_copy(update=stated) if name in merged else table
    return merged


Text = Annotated[
    str, pydantic.BeforeValidator(lambda given: given.isoformat() if isinstance(given, datetime.date) else given)
]
"""Text, or a date of TOML, which has no quotes."""
Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]
Positive = Annotated[float, pydantic.Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, pydantic.Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, pydantic.Field(gt=0, lt=1)]
Count = Annotated[int, pydantic.Field(ge=1)]
Seed = Annotated[int, pydantic.Field(ge=0)]
Gauge = Annotated[float, pydantic.Field(ge=0, le=1e6)]
"""Pa gauge at the turbine's inlet."""


class StartValue(Table):
    """Start value and bounds of a parameter or gain in SI units; lists for vectors."""

    value: float | list[float] | None = None
    """Start value; of what is held, its value."""
    lower: float | list[float] | None = None
    """No fitted value is lower."""
    upper: float | list[float] | None = None
    """No fitted value is higher."""


class ParameterValue(StartValue):
    """What is known of a parameter before a fit.

    `deviation` in its unit, or `relative` to the value, says how well it is known: of what is fitted a Gaussian prior,
    of what is held a tolerance that goes into every error.
    """

    deviation: Positive | None = None
    """Standard deviation of what is known beforehand, in the unit of the parameter: a prior where it is free, a
    tolerance that goes into every error where it is held."""
    relative: Positive | None = None
    """The same as a part of the value; one of the two."""
    scale: Literal["log", "linear"] | None = None
    """Whether a fit moves it by its logarithm or linearly, and a prior is of its logarithm or of itself; by default
    positive ones by their logarithm."""

    @pydantic.model_validator(mode="after")
    def _one_size(self) -> "ParameterValue":
        if self.deviation is not None and self.relative is not None:
            raise ValueError("a parameter has a deviation or a relative one, but there are both; drop one")
        return self
