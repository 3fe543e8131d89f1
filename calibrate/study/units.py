"""A command's work laid out: the study read, every trace loaded and checked, a model for every unit."""

import contextlib
import dataclasses
import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import vgtjax
from vgtjax import InputError
from vgtjax.estimation import FoundDuty, Unknown
from vgtjax.parameters import Bounds, Scale
from vgtjax.traces import STANDARD_ATMOSPHERE, TRAVEL

from ..output.console import console
from ..output.software import software
from .channels import sources_of
from .disturbances import Disturbance
from .given import options_given
from .models import (
    Known,
    build_model,
    known_beforehand,
    parameters_of,
    say_not_as_stated,
    scales_of,
    start_model,
    start_values,
)
from .places import StudyError, of_study
from .read import EXAMPLE, TraceSource, expand_traces, fingerprint, hash_file, load_study
from .start_file import beside, load_beginning, load_duties, load_values
from .tables import BenchSensor, Study


@dataclasses.dataclass(frozen=True, eq=False)
class StudyJob:
    """A study that was read and checked: nothing has been written yet.

    `text` is the file word by word, `fingerprint` a digest of all that a result depends on.
    """

    study: Study
    text: str
    fingerprint: str

    def heading(self, unit: str | None = None) -> dict[str, Any]:
        """What every report says of its study."""
        title = self.study.report.title or self.study.name
        return {
            "title": title if unit is None else f"{title}: {unit}",
            "study": self.study,
            "study_text": self.text,
            "fingerprint": self.fingerprint,
            "given": options_given(),
        }

    def account(self, seconds: float) -> dict[str, Any]:
        """What every summary says of its study, and of what computed it."""
        return {"wall_seconds": round(seconds, 3), "study_sha256": self.fingerprint, "software": software()}


@dataclasses.dataclass(frozen=True, eq=False)
class Unit:
    """One actuator of a study; `name` is `None` for a study without units."""

    name: str | None
    model: vgtjax.AbstractModel
    bounds: Bounds
    known: Known
    """What the study knows of values beforehand."""
    scales: Mapping[str, Scale]
    """How those entries move in a fit of which the study says it."""
    traces: Sequence[tuple[str, vgtjax.Trace]]
    """`fit` or `validate`, and the trace as the study says that it acted."""
    recorded: Mapping[str, vgtjax.Trace]
    """The same by name, with the times that were recorded: without a stated delay, and what else its sensors do not
    show."""
    duties: Mapping[str, FoundDuty]
    """What earlier parameters say of the duty of each trace."""
    hashes: Mapping[str, str]
    """SHA-256 of the file of every trace, by its name."""
    stated: Mapping[str, list[Any]]
    """What the study states of the duty of its traces, so that a fit does not look for it: values of `duty_delay` and
    `duty_hold`."""

    def used(self, use: str) -> list[vgtjax.Trace]:
        """The traces for one use."""
        return [trace for kind, trace in self.traces if kind == use]

    def unknown(self, study: Study) -> Unknown:
        """What a fit of its traces finds out besides the parameters."""
        table = study.fit.unknown.model_copy(update=dict.fromkeys(self.stated, False))
        free = {"gain": tuple(table.gain), "offset": tuple(table.offset)}
        return Unknown(loss=study.fit.loss, **{**dict(table), **free})

    def folder(self, out: pathlib.Path) -> pathlib.Path:
        """Where this unit's files go."""
        return out if self.name is None else out / self.name


@dataclasses.dataclass(frozen=True, eq=False)
class Job(StudyJob):
    """Everything that a command on measured traces needs."""

    units: list[Unit]


def prepare(
    path: pathlib.Path | None,
    parameters: pathlib.Path | None,
    *,
    to_fit: bool = False,
    as_recorded: bool = False,
) -> Job:
    """Reads and checks everything that a command will use.

    **Arguments:** `path`: the study, or `None` for the example that ships; `parameters`: of an earlier fit;
    `to_fit`: whether every trace needs a signal that can be fitted, and every unit a trace for that; `as_recorded`:
    whether traces stay without the study's disturbances, for what reads samples and does not simulate them.
    """
    path = EXAMPLE if path is None else path
    study = _holding_replaced(load_study(path))
    if not study.trace:
        raise InputError(f"{path.name}: a study needs at least one [[trace]], but it has none; add one with its file")
    with of_study():
        model = build_model(study)
        start_values(model, parameters_of(study))  # mistakes are found before the traces are read, which takes longer
    sources = expand_traces(study, path.parent)
    units, given = [], {}
    for name in sorted({source.unit for source in sources}, key=str):
        values: dict[str, Any] = {} if parameters is None else load_values(parameters, name, study, model)
        mine = [source for source in sources if source.unit == name]
        duties = {} if parameters is None else _beside_stated(load_duties(parameters, name), mine)
        given[name] = {**values, "duties": duties}
        with contextlib.nullcontext() if values else of_study():  # the file of an earlier fit has a name of its own
            start, bounds = start_model(model, study, values)
        say_not_as_stated(start, study, {} if parameters is None else load_beginning(parameters, name))
        needs = (*start.needs, *(("x_d|p_act",) if to_fit else ()))
        files = {source.name: _load_file(source, start, bounds, needs) for source in mine}
        traces = [(source.use, _late(files[source.name], source)) for source in mine]
        recorded = {source.name: _in_window(files[source.name], source) for source in mine}
        if to_fit:
            _say_fitted_too(mine)
        stated_values = parameters_of(study)
        known, scales = known_beforehand(start, stated_values), scales_of(start, stated_values)
        hashes = {source.name: hash_file(source.path) for source in mine}
        units.append(Unit(name, start, bounds, known, scales, traces, recorded, duties, hashes, _stated(mine)))
    for unit in units:
        if to_fit and not unit.used("fit"):
            where = "" if unit.name is None else f" of unit '{unit.name}'"
            raise StudyError(f"a fit needs at least one trace{where} with use = 'fit'; mark one")
    units = units if as_recorded else _disturbed(units, study.disturbances())
    return Job(study, path.read_text(encoding="utf-8-sig"), fingerprint(study, sources, given), units)


def _stated(sources: Sequence[TraceSource]) -> dict[str, list[Any]]:
    """What a study states of the duty of some traces."""
    found = {}
    for key in ("duty_delay", "duty_hold"):
        values = [getattr(source, key) for source in sources]
        if any(value is not None for value in values):
            found[key] = [value for value in values if value is not None]
    return found


def _say_fitted_too(sources: Sequence[TraceSource]) -> None:
    """Says of which samples to validate the fit knows."""
    fitted = [source for source in sources if source.use == "fit"]
    for source in sources:
        if source.use == "validate" and any(_overlap(source, other) for other in fitted):
            console.print(
                f"note: {source.name}: what is fitted as well of its samples validates nothing; give it a window "
                "of its own"
            )


def _overlap(one: TraceSource, other: TraceSource) -> bool:
    begin, end = zip(*(each.window or (-math.inf, math.inf) for each in (one, other)), strict=True)
    return one.path == other.path and max(begin) < min(end)


def _beside_stated(duties: Mapping[str, FoundDuty], sources: Sequence[TraceSource]) -> dict[str, FoundDuty]:
    """What an earlier fit has found of duties, less what the study states of them, which counts."""
    found = dict(duties)
    for source in sources:
        if source.name in found:
            found[source.name] = beside(found[source.name], source.duty_delay, source.duty_hold)
    return found


def _holding_replaced(study: Study) -> Study:
    """`study` with those parameters held that a flow map over plunger position has replaced."""
    if study.model != "plunger-map":
        return study
    fixed = [*study.fit.fixed, "converter.*orifice*"]
    return study.model_copy(update={"fit": study.fit.model_copy(update={"fixed": fixed})})


def load_source(
    source: TraceSource, model: vgtjax.AbstractModel, bounds: Bounds, needs: tuple[str, ...]
) -> vgtjax.Trace:
    """The trace of a source, checked against what the rod can do; `needs`: columns, alternatives joined by `|`."""
    return _late(_load_file(source, model, bounds, needs), source)


def _load_file(
    source: TraceSource, model: vgtjax.AbstractModel, bounds: Bounds, needs: tuple[str, ...]
) -> vgtjax.Trace:
    """The whole of it, with a duty as the study says that it is between its samples."""
    travel = float(vgtjax.get_parameter(model, "diaphragm.travel"))
    trace = vgtjax.load_trace(
        source.path,
        channels=sources_of(source.channels),
        atmosphere=STANDARD_ATMOSPHERE if source.atmosphere is None else source.atmosphere,
        travel=max(TRAVEL, travel, bounds.get("diaphragm.travel", (None, None))[1] or 0.0),
        needs=needs,
        ignore=("f_drive",) if "p_act" in model.sensed else (),
        name=source.name,
    )
    return trace.with_ramped_duty() if trace.pwm is not None and source.duty_hold == "linear" else trace


def _late(trace: vgtjax.Trace, source: TraceSource) -> vgtjax.Trace:
    """The window of a trace, with the delay of its duty that the study knows."""
    # What reaches the valve in a window may have been asked for before it.
    if trace.pwm is not None and source.duty_delay:
        trace = trace.with_late_duty(source.duty_delay)
    return _in_window(trace, source)


def _in_window(trace: vgtjax.Trace, source: TraceSource) -> vgtjax.Trace:
    """The window that a study names, without the gains of sensors that it knows."""
    with of_study():
        if source.window is not None:
            trace = trace.window(*source.window)
        return _without_gains(trace, source.gain)


def _disturbed(units: list[Unit], disturbances: Sequence[Disturbance]) -> list[Unit]:
    """The same units with every trace as the actuator felt it, with what its sensors do not show."""
    for disturbance in disturbances:
        units = [
            dataclasses.replace(unit, traces=[(use, disturbance.applied(trace)) for use, trace in unit.traces])
            for unit in units
        ]
    return units


def _without_gains(trace: vgtjax.Trace, gains: Mapping[BenchSensor, float]) -> vgtjax.Trace:
    """What was there, where sensors are known to have shown more or less of it."""
    for name, gain in gains.items():
        if name not in trace.channels:
            raise InputError(f"{trace.name}: a gain of {name} needs that column, but the trace has none; drop the gain")
        channel = trace.channels[name]
        trace = trace.replace(**{name: dataclasses.replace(channel, value=channel.value / gain)})
    return trace
