"""Pictures of tuning: what each closed loop gained, and how the worst ones look."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.control import ClosedLoop

from ..output.figures import curve, points, styled
from .outcome import Comparison

REFERENCE, START, TUNED = "#475569", "#9aa5b1", "#c2410c"


def spread(comparison: Comparison) -> go.Figure:
    """RMS error of every closed loop before and after, sorted by what it is after."""
    labels = [str(label) for label in comparison.problem.cases.labels]
    order = np.argsort(np.nan_to_num(comparison.tuned.rms, nan=np.inf))
    places, hovertext = np.arange(len(order)), [labels[i] for i in order]
    figure = go.Figure()
    for name, costs, color in (("start", comparison.start, START), ("tuned", comparison.tuned, TUNED)):
        for kind, values, symbol in (("RMS", costs.rms, "circle"), ("peak", costs.peak, "triangle-up-open")):
            error, label = 1e6 * values[order], f"{kind}, {name}"
            figure.add_trace(points(places, error, label, color, 6, symbol=symbol, hovertext=hovertext))
    figure.update_yaxes(type="log")
    return styled(figure, 380, "closed loop, sorted by its tuned RMS error", "error, um", hovermode="closest")


def run_figure(before: ClosedLoop, after: ClosedLoop, index: int) -> go.Figure:
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
