"""The command `simulate`: the model on every trace of a study."""

import pathlib

import numpy as np

import vgtjax
from vgtjax import SimulationError
from vgtjax.traces import SIGNALS

from ..output.console import console, say_notes
from ..output.files import claim, columns_csv, write_text
from ..resumable import unit_folders
from ..study.units import prepare


def run(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `<trace name>.csv` for every trace: physical values without sensor offsets.

    **Raises:** `SimulationError` naming the traces that failed, after the others are written.
    """
    job = prepare(study, parameters)
    claim(out, "simulate", job.fingerprint)
    failed = []
    for unit, folder in unit_folders(job, out):
        say_notes(trace for _, trace in unit.traces)
        for _, trace in unit.traces:
            path = folder / f"{trace.name}.csv"
            if path.exists():
                console.print(f"{path} is there already")
                continue
            duty = unit.duties.get(trace.name)
            applied = trace if duty is None else duty.applied(trace)
            try:
                solution = vgtjax.simulate(unit.model, applied)
            except SimulationError as error:
                failed.append(str(error))
                continue
            write_text(path, to_csv(trace, solution, applied.rows_at(trace.time)))
            console.print(f"wrote {path}")
    if failed:
        raise SimulationError("; ".join(each.removesuffix(".") for each in failed))


def to_csv(trace: vgtjax.Trace, solution: vgtjax.Solution, rows: np.ndarray) -> str:
    """A simulated trace as text, inputs first, then the signals under the headers of a bench trace. A duty that was
    linear between samples is written as what held duty has its mean.

    `rows` of the solution are those at the times of the trace.
    """
    trace = trace.with_held_duty()
    columns = {"time [s]": trace.time}
    for name in ("pwm", "p_res", "p_trb"):
        values = trace.at(name)
        if values is not None:
            columns[f"{name} [{SIGNALS[name].unit}]"] = values
    for name, signal in SIGNALS.items():
        if name in solution.signals:
            columns[f"{name} [{signal.unit}]"] = (
                np.asarray(solution.signals[name])[rows] + 0.0
            )  # minus zero is a plain zero
    return columns_csv(columns)
