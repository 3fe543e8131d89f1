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


NotNegative = Annotated[float, pydantic.Field(ge=0, allow_inf_nan=False)]
Gauge = Annotated[float, pydantic.Field(ge=0, le=1e6)]
"""Pa gauge at the turbine's inlet."""


class ReferenceEntry(Table):
    """One reference of the position: m, s, rad/s. Which keys it has depends on its kind."""

    kind: Literal["sine", "steps", "ramps", "signal-1", "signal-2", "trace"]
    name: str | None = None
    begin: NotNegative = 0.0
    """s of the signal at which runs begin."""
    amplitude: Finite | None = None
    rate: Positive | None = None
    offset: Finite | None = None
    phase: Finite | None = None
    times: list[Finite] | None = None
    levels: list[Finite] | None = None
    initial: Finite | None = None
    rise: Positive | None = None
    rounding: Positive | None = None
    file: str | None = None

    @property
    def given(self) -> dict[str, Any]:
        """What the study states of the signal itself."""
        own = self.model_fields_set - {"kind", "name", "begin"}
        return {key: getattr(self, key) for key in sorted(own)}


class CostTable(Table):
    """What counts as one in the cost of a closed loop; a scale that is not given leaves its term out."""

    tracking: Positive = 1e-5
    """m"""
    effort: Positive | None = None
    """%"""
    chatter: Positive | None = 5.0
    """% from one sample to the next."""
    largest_error: Positive | None = None
    """m; beyond it every error costs ten times more."""
    worst: Annotated[float, pydantic.Field(ge=0, le=1)] = 0.5


class UnseenTable(Table):
    """What tuned gains are tried on that they were not tuned on."""

    reference: Annotated[list[ReferenceEntry], pydantic.Field(min_length=1)] | None = None
    turbine_pressure: Annotated[list[Gauge], pydantic.Field(min_length=1)] | None = None
    plants: Annotated[int, pydantic.Field(ge=0)] = 12


class ControlTable(Table):
    """A controller, what it has to do, and which of its gains are tuned."""

    design: Literal["pi", "pid", "pi-knocker", "friction-compensation", "backstepping", "adaptive-backstepping"] = (
        "backstepping"
    )
    free: list[str] | None = None
    fixed: list[str] = []
    gains: dict[str, StartValue] = {}
    reference: list[ReferenceEntry] | None = None
    turbine_pressure: Annotated[list[Gauge], pydantic.Field(min_length=1)] = [0.0]
    plants: Count = 8
    duration: Positive = 8.0
    settled: NotNegative = 2.0
    period: Positive = 1e-3
    sensors: Literal["bench", "ideal"] = "bench"
    seed: Annotated[int, pydantic.Field(ge=0)] = 0
    lanes: Count = 64
    derivative_memory: list[Annotated[float, pydantic.Field(gt=0)]] | None = None
    """s; infinite is exact."""
    cost: CostTable = CostTable()
    unseen: UnseenTable = UnseenTable()

    @pydantic.model_validator(mode="after")
    def _long_enough(self) -> "ControlTable":
        if not self.settled < self.duration or not self.period < self.duration:
            raise ValueError(
                f"a run must go on after settled and be longer than a period, but duration is {self.duration:g} s, "
                f"settled {self.settled:g} s and period {self.period:g} s; lengthen duration"
            )
        return self


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
    control: ControlTable = ControlTable()
