"""The report of tuning: one HTML file that carries all it shows."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

import vgtjax
from vgtjax.control import ClosedLoop
from vgtjax.tuning import TuningProblem, wanted_widths

from ..output.closed_loops import ERRORS, Summaries, along_each, of_plants, spread_figure
from ..output.figures import REFERENCE, convergence_figure, curve, styled
from ..output.page import render_page
from ..study.parameter_file import Entry
from .job import TuneJob
from .outcome import Comparison, Outcome

START, TUNED = "#9aa5b1", "#c2410c"
SUMMARIES: Summaries = {"cost": ("costs", np.mean), **ERRORS}


def render(job: TuneJob, outcome: Outcome, entries: list[Entry], summary: dict[str, Any]) -> str:
    """The report as HTML."""
    return render_page(
        "tune.html.jinja",
        **job.heading(),
        summary=summary,
        worse_elsewhere=bool(outcome.worse_elsewhere),
        entries=entries,
        convergence=convergence_figure(outcome.progress.history, "cost of the smoothed loops"),
        smoothed=_smoothed(job),
        groups=[
            ("Closed loops that gains were tuned on", _table(outcome.true), _spread_figure(outcome.true)),
            ("Closed loops that gains were not tuned on", _table(outcome.unseen), _spread_figure(outcome.unseen)),
        ],
        runs=_runs(outcome),
    )


def _smoothed(job: TuneJob) -> list[tuple[str, float, float]]:
    """What switches or jumps in controller, plant and sensors: its own width, and that while tuning."""

    def widths(problem: TuningProblem) -> dict[str, float]:
        plants: Any = problem.cases.plants
        sensors = problem.cases.scenarios.sensors
        return {
            "lift over which the atmosphere's orifice opens, m": plants.converter.opening_width,
            "step of the position's sensor, m": float(np.max(sensors.position.quantum)),
            "step of the pressure's sensor, Pa": float(np.max(sensors.pressure.quantum)),
            **{
                name: float(vgtjax.get_parameter(problem.controller, name))
                for name in wanted_widths(problem.controller)
            },
        }

    true, smooth = widths(job.true), widths(job.smooth)
    return [(name, true[name], smooth[name]) for name in true]


def _table(comparison: Comparison) -> list[dict[str, Any]]:
    """A row for every reference and turbine pressure: the middle and the worst of the plants."""
    return [
        head | {"cells": [of_plants(costs, mine, SUMMARIES) for costs in (comparison.start, comparison.tuned)]}
        for head, mine in along_each(comparison.problem.cases.labels)
    ]


def _runs(outcome: Outcome) -> list[tuple[str, go.Figure]]:
    """The worst closed loop of every reference, tuned on and not."""
    sections = []
    for comparison, remark in ((outcome.true, ""), (outcome.unseen, " (not tuned on)")):
        worst = comparison.worst()
        before = comparison.problem.simulate(comparison.problem.start, worst)
        after = comparison.problem.simulate(outcome.coordinates, worst)
        for place, index in enumerate(worst):
            title = f"{comparison.problem.cases.labels[index]}{remark}"
            sections.append((title, _run_figure(before, after, place)))
    return sections


def _spread_figure(comparison: Comparison) -> go.Figure:
    """Errors of every closed loop before and after, sorted by what they are after."""
    errors = [
        (f"{kind}, {name}", values, color, symbol)
        for name, costs, color in (("start", comparison.start, START), ("tuned", comparison.tuned, TUNED))
        for kind, values, symbol in (("RMS", costs.rms, "circle"), ("peak", costs.peak, "triangle-up-open"))
    ]
    return spread_figure(comparison.problem.cases.labels, errors, ("tuned RMS error", comparison.tuned.rms))


def _run_figure(before: ClosedLoop, after: ClosedLoop, index: int) -> go.Figure:
    """One closed loop with the start's gains and with the tuned ones: position, error, duty."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.04, row_heights=[2, 1.4, 1.4])
    time = np.asarray(after.time[index])
    reference = np.asarray(after.reference.position[index])
    figure.add_trace(curve(time, reference * 1e3, "reference", REFERENCE, dash="dash"), row=1, col=1)
    for name, run, color in (("start", before, START), ("tuned", after, TUNED)):
        rows = (run.position[index] * 1e3, run.error[index] * 1e6, run.duty[index])
        for row, values in enumerate(rows, 1):
            figure.add_trace(curve(time, values, name, color, showlegend=row == 1), row=row, col=1)
    for row, title in enumerate(("position, mm", "error, um", "duty, %"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=3, col=1)
    return styled(figure, 560)
