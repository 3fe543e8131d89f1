"""The command `simulate`: the model on every trace of a study."""

import pathlib
from collections.abc import Iterator, Sequence

import numpy as np

import vgtjax
from vgtjax import InputError, SimulationError
from vgtjax.traces import SIGNALS, require

from ..output.console import console, say_notes
from ..output.files import claim, columns_csv, release, write_text
from ..resumable import unit_folders
from ..study.units import Unit, prepare


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `<trace name>.csv` for every trace: physical values without sensor offsets.

    **Raises:** `InputError` for a trace that can't drive the model, before anything is written; `SimulationError`
    naming the traces that failed, after the others are written.
    """
    job = prepare(study, parameters)
    acted = {unit.name: _as_they_acted(unit) for unit in job.units}
    claim(out, "simulate", job.fingerprint)
    try:
        failed = [each for unit, folder in unit_folders(job, out) for each in _simulate(unit, acted[unit.name], folder)]
        if failed:
            raise SimulationError("; ".join(each.removesuffix(".") for each in failed))
    except (InputError, SimulationError):
        release(out)
        raise


def _as_they_acted(unit: Unit) -> list[vgtjax.Trace]:
    """The traces of a unit with the duty that reached its valve.

    **Raises:** `InputError` for one that can't drive the model.
    """
    acted = []
    for _, trace in unit.traces:
        duty = unit.duties.get(trace.name)
        acted.append(trace if duty is None else duty.applied(trace))
        require(acted[-1], unit.model.needs)
    return acted


def _simulate(unit: Unit, acted: Sequence[vgtjax.Trace], folder: pathlib.Path) -> Iterator[str]:
    """Writes what is not there yet; yields a sentence for every trace that failed."""
    say_notes(acted)
    for trace in acted:
        path = folder / f"{trace.name}.csv"
        if path.exists():
            console.print(f"{path} is there already")
            continue
        try:
            solution = vgtjax.simulate(unit.model, trace)
        except SimulationError as error:
            yield str(error)
            continue
        write_text(path, to_csv(unit.recorded[trace.name], trace, solution))
        console.print(f"wrote {path}")


def to_csv(recorded: vgtjax.Trace, acted: vgtjax.Trace, solution: vgtjax.Solution) -> str:
    """A simulated trace as text, inputs first, then the signals under the headers of a bench trace: at the times that
    were recorded, with the duty that was, and pressures as they acted.

    A duty that was linear between samples is written as what held duty has its mean.
    """
    inputs = {
        "pwm": recorded.with_held_duty().at("pwm"),
        "p_res": acted.at("p_res", recorded.time),
        "p_trb": acted.at("p_trb", recorded.time),
    }
    columns = {"time [s]": recorded.time}
    columns |= {f"{name} [{SIGNALS[name].unit}]": values for name, values in inputs.items() if values is not None}
    rows = acted.rows_at(recorded.time)
    for name, signal in SIGNALS.items():
        if name in solution.signals:
            columns[f"{name} [{signal.unit}]"] = (
                np.asarray(solution.signals[name])[rows] + 0.0
            )  # minus zero is a plain zero
    return columns_csv(columns)
