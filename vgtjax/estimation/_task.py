"""What to calibrate: which parameters, by which traces."""

import collections
import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast, get_args

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError, require_positive
from ..parameters import (
    Bounds,
    Scale,
    Selection,
    Transform,
    bounds_by_entry,
    build_transform,
    match_entries,
    parameter_table,
    replace_parameters,
    select,
    unknown_name,
)
from ..plants import AbstractModel, bare
from ..simulation import AbstractFixedStepping, FixedStep
from ..traces import SIGNALS, Trace
from .derivatives import CHANNELS, StepsOfFit, lengthens
from .measurements import (
    NOTHING,
    RECORDED,
    InputSensor,
    Late,
    Prior,
    Reading,
    Unknown,
    instrumented,
    read_duties,
    read_inputs,
)

RUNAWAY = 1e5
"""Factor by which a positive value may leave its start. In fits of twenty actuators none moves by more than 10^1.7;
from a hopeless start a fit goes to where nothing changes any more, converges there, and leaves a mass of 1e88 kg."""


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """What to calibrate: a model with its start values, the free entries, and the traces.

    `bounds` are by entry, in the units of the table; `channels` the measured signals to fit; `unknown` is what the fit
    finds out besides. `deviations` by entry, in the units of the table, say how well a value is known beforehand: of a
    free entry that is a Gaussian prior, about what `centers` has of it, else its start value, of one that is held a
    tolerance that goes into every error. `scales` by entry say how those move that do not move as the table has them.
    `linear` has
    the sample intervals in s of traces whose duty is linear between samples, though they don't say so, `edges` by how
    many samples every edge of the duty of each trace is late, where that is not as it is recorded, beside `edges_delay`
    s of the whole duty. `starts` is from how many places a search begins, `gains` by channel how well the gain of each
    sensor is known, relative, `inputs` what is known of the sensor of the pressure by which each trace to fit is
    driven, which is read without its noise. A search that hardly comes nearer to a cost of `ceiling`, and is far above
    it, is given up, with the duty as it is recorded and by the `reading` by which another structure reaches that. A
    `finer` one takes no longer steps along slow traces than along others. `second_guess` says what
    traces tell of some parameters, by name, without a simulation, beside the other values of a model.
    """

    model: AbstractModel
    selection: Selection
    fit: Sequence[Trace]
    validate: Sequence[Trace] = ()
    bounds: Bounds = dataclasses.field(default_factory=dict)
    channels: Sequence[str] = CHANNELS
    stepping: FixedStep = dataclasses.field(default_factory=FixedStep)
    unknown: Unknown = NOTHING
    deviations: dict[str, float] = dataclasses.field(default_factory=dict)
    centers: dict[str, float] = dataclasses.field(default_factory=dict)
    scales: dict[str, Scale] = dataclasses.field(default_factory=dict)
    linear: Sequence[float] = ()
    edges: Late = ()
    edges_delay: float = 0.0
    starts: int = 1
    gains: dict[str, float] = dataclasses.field(default_factory=dict)
    inputs: Sequence[InputSensor | None] = ()
    ceiling: float = np.inf
    reading: Reading = RECORDED
    finer: bool = False
    second_guess: Callable[[AbstractModel, Sequence[Trace]], Mapping[str, Any]] | None = None

    def of_parts(self, samples: Mapping[int, int]) -> "Task":
        """The same task with the first samples of some of the traces to fit, by number; not for one whose duty is read
        otherwise."""
        assert not self.edges, "edges are by trace"
        inputs = [self.inputs[number] for number in samples] if self.inputs else self.inputs
        parts = [
            self.fit[number].window(-np.inf, self.fit[number].time[count - 1]) for number, count in samples.items()
        ]
        return dataclasses.replace(self, fit=parts, inputs=inputs, validate=())

    @property
    def steps(self) -> AbstractFixedStepping:
        """The steps of its simulations, but for those whose numerical errors may not show."""
        corrected = self.unknown.numerics and not self.finer
        return StepsOfFit(self.stepping) if corrected else self.stepping

    @property
    def lengthens(self) -> bool:
        """Whether it takes longer steps along a trace to fit, as it corrects for what these do."""
        return self.unknown.numerics and not self.finer and any(lengthens(self.model, trace) for trace in self.fit)

    @property
    def plant(self) -> AbstractModel:
        """The model without the sensors that may be off."""
        return bare(self.model)

    @functools.cached_property
    def traces(self) -> list[Trace]:
        """Traces to fit, with the duty as it is read."""
        return read_duties(self.fit, self.linear, self.edges, self.edges_delay)

    @property
    def tolerances(self) -> dict[str, float]:
        """Deviations of entries that are held, in the order of the table, as derivatives with respect to them are."""
        held = [entry for entry in self.deviations if entry not in self.selection.entries]
        return {entry: self.deviations[entry] for entry in select(self.model, held).entries}

    def transform(self, bounds: Bounds | None = None) -> Transform:
        """The map between values of the free entries and their coordinates, which holds them within bounds: those of
        the task unless others are given."""
        start = self.selection.values(self.model)
        bounds = self.bounds if bounds is None else bounds
        return build_transform(parameter_table(self.model), self.selection.entries, start, bounds, self.scales)

    @property
    def prior(self) -> Prior | None:
        """What is known of the free entries beforehand; `None` for nothing."""
        entries, transform = self.selection.entries, self.transform({})
        start = self.selection.values(self.model).tolist()
        stated = np.array([self.deviations.get(entry, np.inf) for entry in entries], float)
        if not np.any(np.isfinite(stated)):
            return None
        about = [self.centers.get(entry, value) for entry, value in zip(entries, start, strict=True)]
        center = np.asarray(transform.to_coordinates(np.array(about, float)))
        precision, more = np.abs(transform.slope(center)) / stated, np.zeros(int(self.late_duty))
        return Prior(np.append(center, more), np.append(precision, more))

    def away(
        self, transform: Transform, coordinates: Float[np.ndarray, " coordinates"]
    ) -> Bool[np.ndarray, " coordinates"]:
        """Which coordinates of positive entries lie more than a factor `RUNAWAY` from their start, and on no bound.

        They are logarithms, finite where a value has left the range of floating point.
        """
        moved = np.abs(coordinates - np.asarray(transform.to_coordinates(self.first_guess)))
        away = (moved > np.log(RUNAWAY)) & transform.positive & ~np.asarray(transform.at_bound(coordinates))
        return away & (np.arange(len(coordinates)) < len(self.selection.entries))

    def inside(self, values: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " parameters"]:
        """Values of the free entries, none beyond its bounds: the way back from a logarithm may pass one by a rounding
        error, and nothing takes such a value."""
        pairs = [self.bounds.get(entry, (None, None)) for entry in self.selection.entries]
        lower, upper = np.array(pairs, float).reshape(-1, 2).T  # None reads as NaN, which fmin and fmax pass by
        return np.fmin(np.fmax(values, lower), upper)

    @property
    def late_duty(self) -> bool:
        """Whether the duty may be late."""
        return bool(self.unknown.duty_delay) and "pwm" in self.model.needs

    @property
    def first_guess(self) -> Float[np.ndarray, " coordinates"]:
        """Start values in the units of the table, and a duty that is not late where it may be."""
        return np.append(self.selection.values(self.model), np.zeros(int(self.late_duty)))


def plan_task(
    model: AbstractModel,
    fit: Sequence[Trace],
    validate: Sequence[Trace] = (),
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    values: dict[str, Any] | None = None,
    bounds: Bounds | None = None,
    channels: Sequence[str] | None = None,
    unknown: Unknown = NOTHING,
    deviations: Mapping[str, float] | None = None,
    centers: Mapping[str, float] | None = None,
    scales: Mapping[str, str] | None = None,
    starts: int = 1,
    gains: Mapping[str, float] | None = None,
    offsets: Mapping[str, float] | None = None,
) -> Task:
    """Puts a task together from names.

    **Arguments:** as those of [`fit`][vgtjax.identification.fit], but that `unknown` is nothing by default.

    **Raises:** `InputError` for unknown names, another scale, a deviation or uncertainty that is not positive, a
    center that its entry can't have, a sensor that can't be free, a search from no place, and when no trace is to be
    fitted.
    """
    model = replace_parameters(model, values or {})
    channels = model.sensed if channels is None else channels
    _check_channels(channels, fit)
    _check_stated(gains or {}, offsets or {}, starts)
    named = _named_apart([*fit, *validate])
    fit, validate = named[: len(fit)], named[len(fit) :]
    fit, inputs = read_inputs(model, fit, unknown)
    validate, _ = read_inputs(model, validate, unknown)
    selection, known, gains = select(model, free, fixed), _deviations(model, deviations or {}), dict(gains or {})
    if unknown.gain or unknown.offset or unknown.start_state or gains or offsets:
        errors = [sensor.offset_error for sensor in inputs if sensor is not None]
        read = bool(errors) and all(errors)  # an offset that is found at rest
        shifts = {channel: size for channel, size in (offsets or {}).items() if not (read and channel == "p_act")}
        found = instrumented(model, selection, fit, unknown, gains, shifts)
        model, selection, known, fit = found.model, found.selection, known | found.deviations, found.traces
        gains = {channel: part for channel, part in gains.items() if channel not in unknown.gain}
    task = Task(
        model,
        selection,
        fit,
        validate,
        bounds_by_entry(model, bounds or {}),
        channels,
        unknown=unknown,
        deviations=known,
        scales=_scales_by_entry(model, scales or {}),
        starts=starts,
        gains=gains,
        inputs=inputs,
    )
    return dataclasses.replace(task, centers=_centers(task, centers)) if centers else task


def _named_apart(traces: Sequence[Trace]) -> list[Trace]:
    """Traces by which results are told apart: those that have one name between them are numbered."""
    counts = collections.Counter(trace.name for trace in traces)
    taken, named = set(counts), []
    for trace in traces:
        if counts[trace.name] > 1:
            name = next(name for k in itertools.count(1) if (name := f"{trace.name} {k}") not in taken)
            taken.add(name)
            trace = trace.replace(name=name)
        named.append(trace)
    return named


def _check_channels(channels: Sequence[str], fit: Sequence[Trace]) -> None:
    if not fit:
        raise InputError("a fit needs at least one trace, but there is none; give one", "traces")
    known = [channels] if isinstance(channels, str) else list(channels)
    if isinstance(channels, str) or not known or not set(known) <= set(CHANNELS):
        raise InputError(
            f"channels to fit must be a list of {' and '.join(CHANNELS)}, but they are {channels!r}; give it"
        )
    if not any(name in trace.channels for trace in fit for name in known):
        raise InputError(f"a fit needs a trace with {' or '.join(known)}, but there is none; record it", "traces")


def _check_stated(gains: Mapping[str, float], offsets: Mapping[str, float], starts: int) -> None:
    _check_sensors(gains, "gains", "number", "use its relative standard uncertainty")
    _check_sensors(offsets, "offsets", "number", "use its standard uncertainty in the unit of its channel")
    require_positive("starts", starts, "number of places", "use 1 for the start values alone")


def _check_sensors(stated: Mapping[str, float], argument: str, what: str, remedy: str) -> None:
    for channel, size in stated.items():
        if channel not in SIGNALS:
            raise unknown_name(f"channel of {argument}", channel, SIGNALS, argument)
        require_positive(f"what {argument} has of {channel}", size, what, remedy)


def _deviations(model: AbstractModel, deviations: Mapping[str, float]) -> dict[str, float]:
    for name, deviation in deviations.items():
        require_positive(f"the deviation of {name}", deviation, "number", "use its standard deviation")
    return _by_entry(model, deviations, "deviations")


def _centers(task: Task, centers: Mapping[str, float]) -> dict[str, float]:
    """Of entries that are free."""
    found, positive = _by_entry(task.model, centers, "centers"), task.transform({}).positive
    by_logarithm = dict(zip(task.selection.entries, positive.tolist(), strict=True))
    mine = {entry: center for entry, center in found.items() if entry in by_logarithm}
    for entry, center in mine.items():
        if by_logarithm[entry]:
            require_positive(f"what a prior of {entry} is about", center, "number", "correct it")
        elif not np.isfinite(center):
            raise InputError(
                f"what a prior of {entry} is about must be a finite number, but it is {center}; correct it", "centers"
            )
    return mine


def _by_entry(model: AbstractModel, stated: Mapping[str, float], argument: str) -> dict[str, float]:
    table = parameter_table(model)
    return {
        entry: float(each) for name, each in stated.items() for entry in sorted(match_entries(table, [name], argument))
    }


def _scales_by_entry(model: AbstractModel, scales: Mapping[str, str]) -> dict[str, Scale]:
    for name, scale in scales.items():
        if scale not in get_args(Scale):
            raise InputError(
                f"the scale of {name} must be one of {', '.join(get_args(Scale))}, but it is {scale!r}; choose one",
                "scales",
            )
    table = parameter_table(model)
    return {
        entry: cast(Scale, scale)
        for name, scale in scales.items()
        for entry in sorted(match_entries(table, [name], "scales"))
    }
