"""A command's work laid out: the study read, every trace loaded and checked, a model for every unit."""

import dataclasses
import pathlib
from typing import Any

import vgtjax
from vgtjax.errors import InputError
from vgtjax.estimation.calibration import Bounds

from .models import build_model, start_values
from .parameter_file import load_values
from .study import EXAMPLE, Study, TraceSource, expand_traces, fingerprint, load_study


@dataclasses.dataclass(frozen=True, eq=False)
class Unit:
    """One actuator of a study; `name` is `None` for a study without units."""

    name: str | None
    model: vgtjax.AbstractModel
    bounds: Bounds
    traces: list[tuple[str, vgtjax.Trace]]
    """`fit` or `validate`, and the trace."""

    def used(self, use: str) -> list[vgtjax.Trace]:
        """The traces for one use."""
        return [trace for kind, trace in self.traces if kind == use]

    def folder(self, out: pathlib.Path) -> pathlib.Path:
        """Where this unit's files go."""
        return out if self.name is None else out / self.name


@dataclasses.dataclass(frozen=True, eq=False)
class Job:
    """Everything a command needs; nothing has been written yet."""

    study: Study
    text: str
    fingerprint: str
    units: list[Unit]


def prepare(path: pathlib.Path | None, parameters: pathlib.Path | None) -> Job:
    """Reads and checks everything that a command will use.

    **Arguments:** `path`: the study, or `None` for the example that ships; `parameters`: of an earlier fit.

    **Raises:** `InputError` for the first thing that is wrong.
    """
    path = EXAMPLE if path is None else path
    study = load_study(path)
    model = build_model(study)
    start_values(model, study)
    sources = expand_traces(study, path.parent)
    names = sorted({source.unit for source in sources}, key=str)
    units, given = [], {}
    for name in names:
        mine = [source for source in sources if source.unit == name]
        values: dict[str, Any] = {} if parameters is None else load_values(parameters, name, study, model)
        given[name] = values
        # An earlier fit is the start; what the study states itself goes before it.
        start = vgtjax.replace_parameters(model, values)
        stated, bounds = start_values(start, study)
        start = vgtjax.replace_parameters(start, stated)
        units.append(Unit(name, start, bounds, [(source.use, _load(source, model)) for source in mine]))
    return Job(study, path.read_text(encoding="utf-8"), fingerprint(study, sources, given), units)


def _load(source: TraceSource, model: vgtjax.AbstractModel) -> vgtjax.Trace:
    atmosphere = {} if source.atmosphere is None else {"atmosphere": source.atmosphere}
    trace = vgtjax.load_trace(source.path, needs=model.needs, name=source.name, **atmosphere)
    if source.window is not None:
        trace = trace.window(*source.window)
    return trace


def check_fit(job: Job) -> None:
    """What a fit needs beyond a simulation.

    **Raises:** `InputError` when a unit has no trace to fit, or a trace nothing to fit it on.
    """
    for unit in job.units:
        if not unit.used("fit"):
            where = "" if unit.name is None else f" of unit '{unit.name}'"
            raise InputError(f"a fit needs at least one trace{where} with use = 'fit'; mark one")
        for _, trace in unit.traces:
            if trace.x_d is None and trace.p_act is None:
                raise InputError(
                    f"{trace.name}: a fit needs a measured column x_d or p_act, but there is neither; record one"
                )
