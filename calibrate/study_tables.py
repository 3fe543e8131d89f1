"""The tables that a study file may have, and what may stand in them."""

from typing import Annotated, Any, Literal

import pydantic


class Table(pydantic.BaseModel):
    """What all tables share: no unknown keys, no conversions, no changes."""

    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, strict=True)


class Components(Table):
    """Which variant of each component; the names are checked where the model is built."""

    friction: str = "lugre"
    vane_force: str = "none"
    line: str = "none"
    magnetic_force: str = "static"
    chamber: str = "adiabatic"
    flow_map: str | None = None
    """Of the reduced models only."""

    @pydantic.model_serializer(mode="wrap")
    def _without_missing(self, serialise: pydantic.SerializerFunctionWrapHandler) -> dict[str, Any]:
        # So that files of models without a flow map stay what they were.
        return {name: value for name, value in serialise(self).items() if value is not None}


class TraceEntry(Table):
    """One `[[trace]]`: a file or glob pattern, and what it is for."""

    file: str
    use: Literal["fit", "validate"] = "fit"
    name: str | None = None
    unit: str | None = None
    atmosphere: Annotated[float, pydantic.Field(ge=3e4, le=1.2e5)] | None = None
    """Pa; between the highest peaks and the deepest mines, so that 1013 is found out to be mbar."""
    window: Annotated[tuple[float, float], pydantic.Strict(False)] | None = None

    @pydantic.field_validator("window")
    @classmethod
    def _ordered(cls, window: tuple[float, float] | None) -> tuple[float, float] | None:
        if window is not None and not window[0] < window[1]:
            raise ValueError(f"a window must end after it begins, but it is {list(window)}; swap the two")
        return window


class Fit(Table):
    """Which parameters move: names or patterns."""

    free: list[str] | None = None
    fixed: list[str] = []


class StartValue(Table):
    """Start value and bounds of a parameter in SI units; lists for vectors."""

    value: float | list[float] | None = None
    lower: float | list[float] | None = None
    upper: float | list[float] | None = None


Positive = Annotated[float, pydantic.Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, pydantic.Field(gt=0, lt=1)]
Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]
Count = Annotated[int, pydantic.Field(ge=1)]


class Spread(Table):
    """How one quantity varies from actuator to actuator, in SI units (a factor around one for a whole vector).

    `relative` is a part of the nominal value, `deviation` the same in its unit: the standard deviation of `normal` and
    `lognormal` (whose median is the nominal value), half the width of `uniform` and `triangular`. `lower` and `upper`
    are ends instead, or where a normal distribution is cut off.
    """

    distribution: Literal["normal", "lognormal", "uniform", "triangular"] = "normal"
    relative: Positive | None = None
    deviation: Positive | None = None
    lower: Finite | None = None
    upper: Finite | None = None


class Correlation(Table):
    """Correlation of two quantities or more, each pair alike."""

    parameters: Annotated[list[str], pydantic.Field(min_length=2)]
    value: Annotated[float, pydantic.Field(ge=-1, le=1)]


class PopulationTable(Table):
    """How actuators of one type differ: fitted units, or tolerances."""

    units: str | None = None
    vary: list[str] | None = None
    fixed: list[str] = []
    relative: Positive = 0.02
    parameters: dict[str, Spread] = {}
    correlation: list[Correlation] = []


class ExperimentsTable(Table):
    """What every actuator goes through."""

    turbine_pressure: list[Annotated[float, pydantic.Field(ge=0, le=1e6)]] | None = None
    """Pa gauge."""
    loop_seconds: float = 30.0
    loop_duty: float = 100.0
    steps: list[float] = [50.0, 80.0]
    step_seconds: float = 2.4


class Limit(Table):
    """What is still good, in the unit of the output's table: mbar, ms, mm."""

    lower: Finite | None = None
    upper: Finite | None = None

    @pydantic.model_validator(mode="after")
    def _stated(self) -> "Limit":
        if self.lower is None and self.upper is None:
            raise ValueError("a limit needs a lower or an upper end, but it has none; write e.g. {upper = 30}")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise ValueError(
                f"the ends of a limit must rise, but they are {self.lower:g} and {self.upper:g}; swap them"
            )
        return self


class ToleranceTable(Table):
    """The Monte Carlo study."""

    samples: Count = 1024
    sampler: Literal["sobol", "latin-hypercube"] = "sobol"
    seed: Annotated[int, pydantic.Field(ge=0)] = 0
    lanes: Count = 1024
    precision: Literal["double", "single"] = "double"
    limits: dict[str, Limit] = {}


class SensitivityTable(Table):
    """The sensitivity study."""

    base: Annotated[int, pydantic.Field(ge=16)] = 512
    seed: Annotated[int, pydantic.Field(ge=0)] = 0
    lanes: Count = 1024
    gradient_points: Count = 16
    replicates: Annotated[int, pydantic.Field(ge=20)] = 200
    confidence: Share = 0.95
    threshold: Share = 0.05


class Study(Table):
    """A whole study file."""

    name: str = "study"
    model: Literal["full", "mechanical", "plunger-map", "static-map"] = "full"
    components: Components = Components()
    trace: list[TraceEntry] = []
    fit: Fit = Fit()
    parameters: dict[str, StartValue] = {}
    population: PopulationTable = PopulationTable()
    experiments: ExperimentsTable = ExperimentsTable()
    tolerance: ToleranceTable = ToleranceTable()
    sensitivity: SensitivityTable = SensitivityTable()
