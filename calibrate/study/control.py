"""`[control]`: a controller, what it has to do, and which of its gains are tuned."""

import math
from typing import Annotated, Any, Literal

import pydantic

from .base import Count, Gauge, NotNegative, Positive, Seed, StartValue, Table
from .loop_disturbances import Delay, LoopDisturbance, LoopSensor, ReservoirTable, SensorTable, VariantTable
from .references import TRIED_ON, TUNED_ON, Reference

Design = Literal[
    "pi",
    "pid",
    "pi-knocker",
    "scheduled-pi",
    "adrc",
    "lqg",
    "friction-compensation",
    "backstepping",
    "adaptive-backstepping",
    "adaptive-position",
]
"""Names of controllers; their classes are in `calibrate/tune/designs.py`."""


class CostTable(Table):
    """What counts as one in the cost of a closed loop; a scale that is not given leaves its term out."""

    tracking: Positive = 1e-5
    """m of error that count as one."""
    effort: Positive = math.inf
    """% of duty that count as one; infinite leaves it out."""
    chatter: Positive = 5.0
    """% from one sample to the next."""
    largest_error: Positive = math.inf
    """m; beyond it every error costs ten times more."""
    worst: Annotated[float, pydantic.Field(ge=0, le=1)] = 0.5
    """Share of the worst case beside the mean."""
    quantile: Annotated[float, pydantic.Field(gt=0, le=1)] = 1.0
    """Below one, the mean of what lies beyond this quantile of the closed loops stands for the worst case."""


class UnseenTable(Table):
    """What tuned gains are tried on that they were not tuned on."""

    reference: Annotated[list[Reference], pydantic.Field(min_length=1)] = TRIED_ON
    """What the position has to follow."""
    turbine_pressure: Annotated[list[Gauge], pydantic.Field(min_length=1)] | None = None
    """Pa gauge; else between those of `[control]`, and the highest of them."""
    plants: Annotated[int, pydantic.Field(ge=0)] = 12
    """How many of the population, other ones than those of `[control]`."""


class ControlTable(Table):
    """A controller, what it has to do, and which of its gains are tuned."""

    design: Design = "backstepping"
    """The controller."""
    belief: Literal["printed", "population", "plant"] | None = None
    """What the controller knows of its plant: the printed actuator, the middle of the population, or the plant itself.
    Without it the population's middle, or the plant where the study states no population."""
    free: list[str] | None = None
    """Gains that are tuned; else all of the design."""
    fixed: list[str] = []
    """Gains that are not."""
    gains: dict[str, StartValue] = {}
    """Start values and bounds of gains."""
    reference: Annotated[list[Reference], pydantic.Field(min_length=1)] = TUNED_ON
    """What the position has to follow."""
    turbine_pressure: Annotated[list[Gauge], pydantic.Field(min_length=1)] = [0.0]
    """Pa gauge; a loop at each."""
    plants: Count = 8
    """How many of the population the gains are tuned on."""
    duration: Positive = 8.0
    """s of each run."""
    settled: NotNegative = 2.0
    """s from which on errors count."""
    period: Positive = 1e-3
    """s from one sample of the controller to the next."""
    sensors: Literal["bench", "ideal"] = "bench"
    """With noise of 8 um and 60 Pa, or without any."""
    sensor: dict[LoopSensor, SensorTable] = {}
    """Sensors that are not as the others."""
    duty_delay: Delay = 0.0
    """s by which the duty reaches the valve later than the controller says it."""
    reservoir: ReservoirTable = ReservoirTable()
    disturbance: list[LoopDisturbance] = []
    """What acts on every closed loop, in this order."""
    variant: list[VariantTable] = []
    """All closed loops once more, each time with something else."""
    fallback: Literal["none", "static-balance"] = "none"
    """What takes over while the position can't be believed."""
    seed: Seed = 0
    """Of the plants and of the sensors' noise."""
    lanes: Count = 64
    """How many closed loops are simulated side by side."""
    derivative_memory: Annotated[list[Annotated[float, pydantic.Field(gt=0)]], pydantic.Field(min_length=1)] | None = (
        None
    )
    """s in which the derivatives of closed loops fade, one search after the other; infinite is exact."""
    cost: CostTable = CostTable()
    unseen: UnseenTable = UnseenTable()

    @pydantic.model_validator(mode="before")
    @classmethod
    def _settled_as_a_cost(cls, raw: Any) -> Any:
        """`settled` may stand beside the costs that count from it on as well."""
        if not isinstance(raw, dict) or not isinstance(raw.get("cost"), dict) or "settled" not in raw["cost"]:
            return raw
        if "settled" in raw:
            raise ValueError("settled must stand once, but it is under [control] and [control.cost]; drop one")
        cost = dict(raw["cost"])
        return {**raw, "settled": cost.pop("settled"), "cost": cost}

    @pydantic.field_validator("variant")
    @classmethod
    def _told_apart(cls, variants: list[VariantTable]) -> list[VariantTable]:
        names = [each.name for each in variants]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two variants are named '{name}'; give each a name of its own")
        return variants

    @pydantic.model_validator(mode="after")
    def _long_enough(self) -> "ControlTable":
        if not self.settled < self.duration or not self.period < self.duration:
            raise ValueError(
                f"a run must go on after settled and be longer than a period, but duration is {self.duration:g} s, "
                f"settled {self.settled:g} s and period {self.period:g} s; lengthen duration"
            )
        return self
