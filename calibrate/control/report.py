"""The report of closed loops: one HTML file that carries all it shows."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.traces import STANDARD_ATMOSPHERE
from vgtjax.tuning import ClosedLoops

from ..output.figures import DUTY, MEASURED, SIMULATED, curve, numbered, points, styled
from ..output.page import render_page
from .job import ControlJob
from .outcome import Outcome, Row

REFERENCE = "#475569"


def render(job: ControlJob, outcome: Outcome, rows: list[Row], summary: dict[str, Any]) -> str:
    """The report as HTML."""
    return render_page(
        "control.html.jinja",
        **job.heading(),
        summary=summary,
        rows=rows,
        gains=job.gains,
        spread=_spread_figure(outcome),
        runs=[(str(group.labels[index]), _run_figure(group, index)) for group, index in _worst(outcome)],
    )


def _worst(outcome: Outcome) -> list[tuple[ClosedLoops, int]]:
    """The closed loop of each reference with the largest RMS error; one that failed before all others."""
    worst: dict[str, tuple[ClosedLoops, int]] = {}
    for group, index in sorted(outcome.loops, key=_rms):
        worst[group.labels[index].course] = group, index
    return list(worst.values())


def _rms(loop: tuple[ClosedLoops, int]) -> float:
    return float(np.nan_to_num(loop[0].rms[loop[1]], nan=np.inf))


def _spread_figure(outcome: Outcome) -> go.Figure:
    """Errors of every closed loop, sorted by their root mean square."""
    loops = sorted(outcome.loops, key=_rms)
    labels, places = [str(group.labels[i]) for group, i in loops], np.arange(len(loops))
    figure = go.Figure()
    for name, color, symbol in (("rms", SIMULATED, "circle"), ("peak", MEASURED, "triangle-up-open")):
        errors = np.array([1e6 * getattr(group, name)[i] for group, i in loops])
        shown = {"rms": "RMS", "peak": "peak"}[name]
        figure.add_trace(points(places, errors, shown, color, 6, symbol=symbol, hovertext=labels))
    figure.update_yaxes(type="log")
    numbered(figure, len(loops))
    return styled(figure, 380, "closed loop, sorted by its RMS error", "error, um", hovermode="closest")


def _run_figure(group: ClosedLoops, index: int) -> go.Figure:
    """One closed loop: position, error, pressure, duty."""
    runs = group.runs
    figure = make_subplots(rows=4, cols=1, shared_xaxes=True, vertical_spacing=0.035, row_heights=[2, 1.4, 1.6, 1.2])
    reference, position = runs.reference[index], runs.position[index]

    def show(values: np.ndarray, name: str, color: str, row: int, **style: Any) -> None:
        figure.add_trace(curve(runs.time, values, name, color, **style), row=row, col=1)

    show(1e3 * reference, "reference", REFERENCE, 1, dash="dash")
    show(1e3 * position, "position", SIMULATED, 1)
    show(1e6 * (reference - position), "error", SIMULATED, 2, showlegend=False)
    told_apart = runs.observed is not None
    show(1e-2 * (runs.pressure[index] - STANDARD_ATMOSPHERE), "true pressure", SIMULATED, 3, showlegend=told_apart)
    if runs.observed is not None:
        show(1e-2 * (runs.observed[index] - STANDARD_ATMOSPHERE), "observed pressure", REFERENCE, 3, dash="dash")
    show(runs.duty[index], "duty", DUTY, 4, showlegend=False, line_shape="hv")
    for row, title in enumerate(("position, mm", "error, um", "pressure, mbar", "duty, %"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=4, col=1)
    return styled(figure, 700)
