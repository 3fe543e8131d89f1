"""The report of closed loops: one HTML file that carries all it shows."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.traces import STANDARD_ATMOSPHERE
from vgtjax.tuning import ClosedLoops

from ..output.closed_loops import spread_figure, worst_of_each
from ..output.figures import DUTY, MEASURED, REFERENCE, SIMULATED, curve, styled
from ..output.page import render_page
from .job import ControlJob
from .outcome import Outcome


def render(job: ControlJob, outcome: Outcome, rows: list[dict[str, Any]], summary: dict[str, Any]) -> str:
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


def _spread_figure(outcome: Outcome) -> go.Figure:
    """Errors of every closed loop, sorted by their root mean square."""
    rms, peak = outcome.figure("rms"), outcome.figure("peak")
    errors = (("RMS", rms, SIMULATED, "circle"), ("peak", peak, MEASURED, "triangle-up-open"))
    return spread_figure([group.labels[i] for group, i in outcome.loops], errors, ("RMS error", rms))


def _worst(outcome: Outcome) -> list[tuple[ClosedLoops, int]]:
    """The closed loop of each reference with the largest RMS error."""
    labels = [group.labels[i] for group, i in outcome.loops]
    return [outcome.loops[place] for place in worst_of_each(labels, outcome.figure("rms"))]


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
