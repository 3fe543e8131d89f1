"""Every design of a controller, tuned by the same tuner on the same loops, and tried on plants that it never saw."""

import functools
import pathlib
import tempfile

import jax
import numpy as np

from vgtjax.control import AbstractController
from vgtjax.tuning import Cases, ClosedLoops, Tuner, TuningProblem, close_loops

from ...control.outcome import CHANNELS, look_at
from ...tune.designs import DESIGNS
from ...tune.job import EXAMPLE, TuneJob, prepare_tuning
from ..kept import KeptRows
from ..nonlinear_mpc import SOLVES, NonlinearMPC
from ..table import Section

UNITS = EXAMPLE.parents[1] / "fleet" / "units"
UNTUNED = "adaptive-position"
SETTLED = 1.0
STUDY = """
[components]
vane_force = "speed-map"
[population]
units = "{units}"
[control]
design = "{design}"
belief = "printed"
turbine_pressure = [0, 3.0e5]
plants = 4
duration = 5.0
settled = {settled}
cost = {{chatter = 2.0}}
[control.unseen]
plants = 8
"""
ON_AN_ENGINE = """
duty_delay = 0.004
[[control.disturbance]]
kind = "pulsation"
amplitude = 0.2
frequency = 33.0
"""
"""What is switched on where a controller is tried on an engine; it was tuned without."""


def measure(keep: pathlib.Path | None = None) -> Section:
    """Tunes each design, and closes its loops on other plants, along other references, with other noise.

    **Arguments:** `keep`: a file for finished rows, from which another call goes on.
    """
    columns = ("design", "measures", "gains", "RMS um", "worst", "peak um", "Pa RMS", "effort %", "chatter %")
    section = Section("Controllers beside each other", _ABOUT, (*columns, "us per sample", "RMS um on an engine"))
    rows = KeptRows(keep, f"{_ABOUT}{STUDY}{ON_AN_ENGINE}")
    for design in DESIGNS:
        section.add(*rows.row(design, functools.partial(_tuned_row, design)))
    section.add(*rows.row(f"{UNTUNED}, default gains", _default_row))
    section.add(*rows.row("nonlinear MPC", _upper_bound))
    return section


def _tuned_row(design: str) -> tuple[str, ...]:
    """The row of a design, with its gains tuned."""
    job = _job(design)
    gains = str(len(job.true.selection.entries))
    return design, *_tried(job, design, _tuned(job.smooth, job.true), gains)


def _default_row() -> tuple[str, ...]:
    """The row of the one design whose default gains are for plants that nobody knows."""
    job = _job(UNTUNED)
    return f"{UNTUNED}, default gains", *_tried(job, UNTUNED, job.true.controller, "none tuned")


def _tried(job: TuneJob, design: str, controller: AbstractController, gains: str) -> tuple[str, ...]:
    """What a controller does on plants, references and noise that it was not tuned on, without and with an engine."""
    loops = _closed(controller, job.unseen.cases)
    engine = _closed(controller, _job(design, ON_AN_ENGINE).unseen.cases)
    used, seconds = look_at(controller, job.unseen.cases)
    measured = ", ".join(CHANNELS[channel] for channel in used)
    return measured, gains, *_figures(loops), f"{1e6 * seconds:.2g}", _number(1e6 * np.median(engine.rms))


def _upper_bound() -> tuple[str, ...]:
    """The row of nonlinear model predictive control, each of whose controllers knows its own plant."""
    cases, shaken = (_job("adaptive-position", more).unseen.cases for more in ("", ON_AN_ENGINE))
    plants = {
        label.plant: jax.tree.map(lambda leaf, i=i: leaf[i], cases.plants) for i, label in enumerate(cases.labels)
    }
    controllers = {name: NonlinearMPC.for_plant(plant) for name, plant in plants.items()}
    SOLVES.take()
    loops, late = (close_loops(controllers, each, settled=SETTLED) for each in (cases, shaken))
    name = f"nonlinear MPC, {SOLVES.take()}"
    used, seconds = look_at(next(iter(controllers.values())), cases)
    measured = ", ".join(CHANNELS[channel] for channel in used)
    return name, measured, "", *_figures(loops), f"{1e6 * seconds:.2g}", _number(1e6 * np.median(late.rms))


def _job(design: str, more: str = "") -> TuneJob:
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "study.toml"
        head, tables = STUDY.format(units=UNITS, design=design, settled=SETTLED).split("[control.unseen]")
        path.write_text(f"{head}{more}[control.unseen]{tables}", encoding="utf-8")
        return prepare_tuning(path, None)


def _tuned(smooth: TuningProblem, true: TuningProblem) -> AbstractController:
    """The controller at the end of tuning."""
    tuner = Tuner(smooth)
    while not tuner.progress.finished:
        tuner.step()
    return true.controller_at(np.asarray(tuner.progress.coordinates))


def _closed(controller: AbstractController, cases: Cases) -> ClosedLoops:
    return close_loops(controller, cases, settled=SETTLED)


def _figures(loops: ClosedLoops) -> list[str]:
    """Of all loops; what failed counts as worst."""
    worst = np.max(np.nan_to_num(loops.rms, nan=np.inf)), np.max(np.nan_to_num(loops.peak, nan=np.inf))
    middle = (np.median(each) for each in (loops.pressure_rms, loops.effort, loops.chatter))
    return [_number(value) for value in (1e6 * np.median(loops.rms), *(1e6 * each for each in worst), *middle)]


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "failed" if np.isinf(value) else ""


_ABOUT = (
    "Each knows the printed actuator alone, without vane force, and is tuned by gradients on the same 16 closed loops "
    "(four fits to simulated turbochargers, a sine and steps, 0 and 3000 mbar); then tried on eight others, Signal 1, "
    "ramps and Signal 2, at 1500 and 3000 mbar, with other noise: middle and worst of 48 loops. 'On an engine': the "
    "same with a duty 4 ms late and a turbine pressure that pulsates by 20 % at 33 Hz, the middle. A sample's time is "
    "that of the compiled update on this machine. Nonlinear MPC (CasADi, IPOPT) is an upper bound: it is told each "
    "plant's own reduced model, and is not tuned; its solves are those of all loops, with and without an engine."
)
