"""Pictures of tuning: how the cost fell, what each closed loop gained, and how the worst ones look."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.control import ClosedLoop
from vgtjax.tuning import TuningProgress

from ..output.figures import styled, thin
from .outcome import Comparison

REFERENCE, START, TUNED = "#475569", "#9aa5b1", "#c2410c"


def convergence(progress: TuningProgress) -> go.Figure:
    """Cost over steps."""
    history = np.asarray(progress.history)
    figure = go.Figure(go.Scatter(x=np.arange(len(history)), y=history, mode="lines+markers", line={"color": TUNED}))
    figure.update_xaxes(title_text="step")
    figure.update_yaxes(title_text="cost of the smoothed loops", type="log")
    return styled(figure, 300)


def spread(comparison: Comparison) -> go.Figure:
    """RMS error of every closed loop before and after, sorted by what it is after."""
    labels = [str(label) for label in comparison.problem.cases.labels]
    order = np.argsort(np.nan_to_num(comparison.tuned.rms, nan=np.inf))
    figure = go.Figure()
    for name, costs, color in (("start", comparison.start, START), ("tuned", comparison.tuned, TUNED)):
        for kind, values, symbol in (("RMS", costs.rms, "circle"), ("peak", costs.peak, "triangle-up-open")):
            figure.add_trace(
                go.Scatter(
                    x=np.arange(len(order)),
                    y=1e6 * values[order],
                    mode="markers",
                    marker={"color": color, "size": 6, "symbol": symbol},
                    name=f"{kind}, {name}",
                    hovertext=[labels[i] for i in order],
                )
            )
    figure.update_xaxes(title_text="closed loop, sorted by its tuned RMS error")
    figure.update_yaxes(title_text="error, um", type="log")
    return styled(figure, 380).update_layout(hovermode="closest")


def run_figure(before: ClosedLoop, after: ClosedLoop, index: int) -> go.Figure:
    """One closed loop with the start's gains and with the tuned ones: position, error, duty."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.04, row_heights=[2, 1.4, 1.4])
    time = np.asarray(after.time[index])
    reference = np.asarray(after.reference.position[index])
    figure.add_trace(_line(time, reference * 1e3, REFERENCE, "reference", dash="dash"), row=1, col=1)
    for name, run, color in (("start", before, START), ("tuned", after, TUNED)):
        rows = (run.position[index] * 1e3, run.error[index] * 1e6, run.duty[index])
        for row, values in enumerate(rows, 1):
            line = _line(time, np.asarray(values), color, name)
            line.showlegend = row == 1
            figure.add_trace(line, row=row, col=1)
    for row, title in enumerate(("position, mm", "error, um", "duty, %"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=3, col=1)
    return styled(figure, 560)


def _line(time: np.ndarray, values: np.ndarray, color: str, name: str, dash: str = "solid") -> go.Scatter:
    x, y = thin(time, values)
    return go.Scatter(
        x=x.astype(np.float32),
        y=y.astype(np.float32),
        mode="lines",
        line={"color": color, "width": 1.2, "dash": dash},
        name=name,
        legendgroup=name,
    )
