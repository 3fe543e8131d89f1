"""The tables that a study file may have, and what may stand in them."""

from typing import Annotated, Any, Literal

import pydantic

from .base import Count, Finite, Gauge, ParameterValue, Positive, Seed, Share, Table, Text
from .channels import Channels
from .components import Components, FullComponents, MechanicalComponents, PlungerMapComponents, StaticMapComponents
from .control import ControlTable
from .disturbances import Disturbance, PulsationTable

BenchSensor = Literal["x_d", "p_act", "p_res", "p_trb", "f_vane", "f_drive"]
Fitted = Literal["x_d", "p_act", "p_res", "p_trb", "f_drive"]
"""Sensors whose gain or offset a fit can find."""


class TraceEntry(Table):
    """One `[[trace]]`: a file or glob pattern, and what it is for."""

    file: str
    """Relative to the study file; patterns such as `step_*.csv` are allowed."""
    use: Literal["fit", "validate"] = "fit"
    """`validate`: only compared with the result."""
    name: str | None = None
    """What the trace is called; else the stem of its file."""
    unit: str | None = None
    """Which actuator it is of; `{stem:7}` stands for the first seven letters of the file's stem."""
    atmosphere: Annotated[float, pydantic.Field(ge=3e4, le=1.2e5)] | None = None
    """Pa; between the highest peaks and the deepest mines, so that 1013 is found out to be mbar."""
    window: Annotated[tuple[float, float], pydantic.Strict(False)] | None = None
    """s; the part of the trace that counts."""
    duty_delay: Annotated[float, pydantic.Field(ge=-0.05, le=0.05)] | None = None
    """s by which the duty is known to reach the valve later than the file says; then it is not looked for."""
    duty_hold: Literal["zero-order", "linear"] | None = None
    """How the duty is known to be between the file's samples; then it is not looked for, and `zero-order` otherwise."""
    gain: dict[BenchSensor, Annotated[float, pydantic.Field(gt=0.5, lt=2.0)]] = {}
    """Known gains of sensors: what was measured is the gain times what was there, and an offset."""
    channels: Channels = {}
    """Where its signals are, where that is not as `[channels]` of the study says."""

    @pydantic.field_validator("window")
    @classmethod
    def _ordered(cls, window: tuple[float, float] | None) -> tuple[float, float] | None:
        if window is not None and not window[0] < window[1]:
            raise ValueError(f"a window must end after it begins, but it is {list(window)}; swap the two")
        return window


class UnknownTable(Table):
    """What a fit may find out besides the parameters; `evidence` lets the traces decide."""

    duty_delay: Literal["evidence"] | bool = "evidence"
    """Whether the duty reaches the valve later than the file says; `true` always looks for a delay."""
    duty_hold: Literal["evidence", False] = "evidence"
    """Whether the duty was held between samples or went in a line; `false`: it was held."""
    noise: Literal["evidence", "white", "coloured"] = "evidence"
    """Whether the noise of a sensor has a memory."""
    numerics: bool = True
    """Whether the numerical errors of the smooth model are corrected."""
    gain: list[Fitted] = []
    """Sensors whose gain is free, one for all traces of a unit; `relative_uncertainty` under `[[report.sensor]]` says
    how well it is known beforehand."""
    offset: list[Fitted] = []
    """Inputs whose sensor's offset is free, one for all traces of a unit; `uncertainty` under `[[report.sensor]]` says
    how well it is known beforehand. Offsets of what is fitted always are, for each trace, and may be named too."""
    start_state: Literal["evidence"] | bool = "evidence"
    """Whether position and pressure at the start are free, else they are the means of the first 50 ms; `evidence`: of
    traces with a duty that do not begin at rest, `true`: of all."""
    input_noise: bool = True
    """Whether the pressure that drives a rod (`model = "mechanical"`) is read without its sensor's noise and without
    what that shows at rest."""


class Fit(Table):
    """Which parameters move: names or patterns; and what else is unknown."""

    free: list[str] | None = None
    """Names or patterns of what moves; else all that is not held by default."""
    fixed: list[str] = []
    """Names or patterns of what does not; it goes before `free`."""
    loss: Literal["evidence", "gaussian", "huber", "student"] = "evidence"
    """How outliers count; `evidence` lets the residuals decide."""
    profiles: Literal["flagged", "all", "none"] = "flagged"
    """Which parameters get a profile likelihood: those of directions whose misfit is no parabola, all, or none."""
    starts: Annotated[int, pydantic.Field(ge=1, le=4096)] = 1
    """From how many places the search begins."""
    posterior: Annotated[int, pydantic.Field(ge=0, le=100_000)] = 0
    """How many draws are taken from the posterior of a fit that converged; they need the extra `posterior`."""
    unknown: UnknownTable = UnknownTable()


class Spread(Table):
    """How one quantity varies from actuator to actuator, in SI units (a factor around one for a whole vector).

    `relative` is a part of the nominal value, `deviation` the same in its unit: the standard deviation of `normal` and
    `lognormal` (whose median is the nominal value), half the width of `uniform` and `triangular`. `lower` and `upper`
    are ends instead, or where a normal distribution is cut off.
    """

    distribution: Literal["normal", "lognormal", "uniform", "triangular"] = "normal"
    """A lognormal one has the nominal value as its median."""
    relative: Positive | None = None
    """As a part of the nominal value: the standard deviation of `normal` and `lognormal`, half the width of `uniform`
    and `triangular`."""
    deviation: Positive | None = None
    """The same in the unit of the parameter; one of the two."""
    lower: Finite | None = None
    """The lower end, in place of a width, or where a normal distribution is cut off."""
    upper: Finite | None = None
    """The upper end."""


class Correlation(Table):
    """Correlation of two quantities or more, each pair alike."""

    parameters: Annotated[list[str], pydantic.Field(min_length=2)]
    """Names of two quantities or more."""
    value: Annotated[float, pydantic.Field(ge=-1, le=1)]
    """Of each pair."""


class PopulationTable(Table):
    """How actuators of one type differ: fitted units, or tolerances."""

    units: str | None = None
    """The folder of a fit with several units, whose population it is; relative to the study file."""
    vary: list[str] | None = None
    """Names or patterns of what varies; else all but the properties of the air, the turbine's nozzle, linkage and gas,
    and what is zero or infinite."""
    fixed: list[str] = []
    """Names or patterns of what does not vary; it goes before `vary`."""
    relative: Positive = 0.02
    """Standard deviation of what is not stated, as a part of its value."""
    parameters: dict[str, Spread] = {}
    correlation: list[Correlation] = []
    passive: bool = True
    """Whether viscous damping is raised where friction could give out energy."""


class ExperimentsTable(Table):
    """What every actuator goes through."""

    turbine_pressure: list[Gauge] | None = None
    """Pa gauge; a slow loop at each."""
    loop_seconds: float = 30.0
    """s, up and down together."""
    loop_duty: float = 100.0
    """%, at the top."""
    steps: list[float] = [50.0, 80.0]
    """% of duty."""
    step_seconds: float = 2.4
    """s for which each is held."""


class Limit(Table):
    """What is still good, in the unit of the output's table: mbar, ms, mm."""

    lower: Finite | None = None
    """What is less is no longer good."""
    upper: Finite | None = None
    """What is more is no longer good."""

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
    """How many actuators."""
    sampler: Literal["sobol", "latin-hypercube"] = "sobol"
    """Sobol' points, scrambled, or a Latin hypercube."""
    seed: Seed = 0
    """Of the samples; the same seed draws the same actuators."""
    lanes: Count = 1024
    """How many are simulated side by side."""
    precision: Literal["double", "single"] = "double"
    """Of the arithmetic of the simulations."""
    limits: dict[str, Limit] = {}
    """By output, `{lower = ..., upper = ...}` in the unit of the report: mbar, ms, mm."""


class SensitivityTable(Table):
    """The sensitivity study."""

    base: Annotated[int, pydantic.Field(ge=16)] = 512
    """Base points; with k quantities there are some k + 1 simulations for each."""
    seed: Seed = 0
    """Of the points."""
    lanes: Count = 1024
    """How many are simulated side by side."""
    gradient_points: Count = 16
    """At how many of them exact gradients are taken."""
    replicates: Annotated[int, pydantic.Field(ge=20)] = 200
    """Of the bootstrap, for intervals."""
    confidence: Share = 0.95
    """Of the intervals."""
    threshold: Share = 0.05
    """Share of the variance from which on a quantity is among the leading ones."""


class ReportSensor(Table):
    """A sensor as its certificate has it: standard uncertainties of its offset in m or Pa, and of its gain."""

    channel: BenchSensor
    """The signal that it measures; where several measure one, each uncertainty of it is one number."""
    serial: str | None = None
    """Its number, as on its certificate."""
    calibrated: Text | None = None
    """Date."""
    uncertainty: Positive | None = None
    """Standard uncertainty (k = 1) of its offset, in m, Pa or N: of an input a part of every error, or what is known
    beforehand where `[fit.unknown] offset` names the sensor; other offsets are found from the traces."""
    relative_uncertainty: Annotated[float, pydantic.Field(gt=0, lt=0.5)] | None = None
    """Standard uncertainty (k = 1) of its gain, e.g. 0.001 for 0.1 %: a part of every error, or what is known
    beforehand where `[fit.unknown] gain` names the sensor."""


class ReportTable(Table):
    """What stands on top of a report that is to be signed."""

    title: str | None = None
    """The headline."""
    id: str | None = None
    """Number of the report."""
    date: Text | None = None
    """Of the report, as it shall stand there."""
    customer: str | None = None
    """For whom it is."""
    item: str | None = None
    """What was calibrated."""
    serial: str | None = None
    """Of what was calibrated."""
    author: str | None = None
    """Who answers for it."""
    sensor: list[ReportSensor] = []

    @pydantic.field_validator("sensor")
    @classmethod
    def _one_number(cls, sensors: list[ReportSensor]) -> list[ReportSensor]:
        for key in ("uncertainty", "relative_uncertainty"):
            found: dict[str, float] = {}
            for sensor in sensors:
                size = getattr(sensor, key)
                if size is not None and found.setdefault(sensor.channel, size) != size:
                    raise ValueError(
                        f"[[report.sensor]] must have one {key} of {sensor.channel}, but it has "
                        f"{found[sensor.channel]:g} and {size:g}; state the one of the sensor that these traces are of"
                    )
        return sensors

    @property
    def lines(self) -> dict[str, str]:
        """What is stated, by name."""
        fields = {name: getattr(self, name) for name in ("id", "date", "customer", "item", "serial", "author")}
        return {name: text for name, text in fields.items() if text is not None}

    @property
    def gains(self) -> dict[str, float]:
        """Relative standard uncertainty of each sensor's gain, where one is stated."""
        stated = ((sensor.channel, sensor.relative_uncertainty) for sensor in self.sensor)
        return {channel: part for channel, part in stated if part is not None}

    @property
    def offsets(self) -> dict[str, float]:
        """Standard uncertainty of each sensor's offset in its unit, where one is stated."""
        stated = ((sensor.channel, sensor.uncertainty) for sensor in self.sensor)
        return {channel: size for channel, size in stated if size is not None}


class Study(Table):
    """A whole study file; a class a model."""

    name: str = "study"
    """What reports call it."""
    data: str | None = None
    """Where the traces come from, e.g. that they are simulated: in the head of every report."""
    model: str
    """What is simulated: `full`, `mechanical`, `plunger-map` or `static-map`."""
    components: Components
    channels: Channels = {}
    """Where the signals are in the files of all traces."""
    trace: list[TraceEntry] = []
    fit: Fit = Fit()
    parameters: dict[str, ParameterValue] = {}
    population: PopulationTable = PopulationTable()
    experiments: ExperimentsTable = ExperimentsTable()
    tolerance: ToleranceTable = ToleranceTable()
    sensitivity: SensitivityTable = SensitivityTable()
    control: ControlTable = ControlTable()
    report: ReportTable = ReportTable()
    pulsation: PulsationTable | None = None

    def disturbances(self) -> list[Disturbance]:
        """What acted on the actuator of every trace without its sensors showing it."""
        return [table.build() for table in (self.pulsation,) if table is not None]


class FullStudy(Study):
    """Of converter, hose, chamber and rod."""

    model: Literal["full"] = "full"
    components: FullComponents = FullComponents()


class MechanicalStudy(Study):
    """Of the rod alone."""

    model: Literal["mechanical"]
    components: MechanicalComponents = MechanicalComponents()


class PlungerMapStudy(Study):
    """Of the model for control with six states."""

    model: Literal["plunger-map"]
    components: PlungerMapComponents = PlungerMapComponents()


class StaticMapStudy(Study):
    """Of the model for control with four states."""

    model: Literal["static-map"]
    components: StaticMapComponents = StaticMapComponents()


def _with_model(raw: Any) -> Any:
    return {"model": "full", **raw} if isinstance(raw, dict) else raw


AnyStudy: pydantic.TypeAdapter[Study] = pydantic.TypeAdapter(
    Annotated[
        FullStudy | MechanicalStudy | PlungerMapStudy | StaticMapStudy,
        pydantic.Field(discriminator="model"),
        pydantic.BeforeValidator(_with_model),
    ]
)
"""Reads a study of any model."""
STUDIES = (FullStudy, MechanicalStudy, PlungerMapStudy, StaticMapStudy)
