"""Pictures of a sensitivity study."""

import numpy as np
import plotly.graph_objects as go

from vgtjax.experiments import Output
from vgtjax.sensitivity import Interval, RankedInput, Ranking

from ..output.figures import styled
from ..population import scaled

KINDS = (
    ("correlation", "SRC (4.1)", "#94a3b8"),
    ("regression", "regression, squared", "#64748b"),
    ("first", "first order", "#1d4ed8"),
    ("total", "total", "#c2410c"),
    ("local", "gradient", "#15803d"),
)
SHOWN = 6
"""Quantities in a bar chart; the rest is in the table."""
COLORS = ("#1d4ed8", "#c2410c", "#15803d", "#7c3aed", "#0e7490", "#b45309", "#be185d", "#4d7c0f", "#334155", "#a16207")


def overview(rankings: tuple[Ranking, ...], threshold: float) -> go.Figure:
    """Total index of every output by every quantity that matters anywhere."""
    totals = [{entry.name: entry.total.value for entry in ranking.inputs} for ranking in rankings]
    names = sorted(
        {name for row in totals for name, value in row.items() if value > threshold},
        key=lambda name: -sum(np.nan_to_num(row[name]) for row in totals),
    )
    values = np.array([[row[name] for name in names] for row in totals], np.float32)
    figure = go.Figure(
        go.Heatmap(
            z=values,
            x=names,
            y=[ranking.output for ranking in rankings],
            zmin=0,
            zmax=1,
            colorscale="Oranges",
            texttemplate="%{z:.2f}",
            colorbar={"title": "total"},
        )
    )
    figure.update_yaxes(autorange="reversed")
    return styled(figure, 200 + 22 * len(rankings)).update_layout(margin={"l": 230, "b": 190}, hovermode="closest")


def bars(ranking: Ranking) -> go.Figure:
    """The indices of one output side by side, with their intervals."""
    leading: list[RankedInput] = [entry for entry in ranking.inputs if not np.isnan(entry.total.value)][:SHOWN]
    figure = go.Figure()
    for kind, name, color in KINDS:
        found: list[Interval] = [getattr(entry, kind) for entry in leading]
        figure.add_trace(
            go.Bar(
                x=[entry.name for entry in leading],
                y=[interval.value for interval in found],
                error_y={
                    "type": "data",
                    "symmetric": False,
                    "array": [max(interval.high - interval.value, 0.0) for interval in found],
                    "arrayminus": [max(interval.value - interval.low, 0.0) for interval in found],
                    "thickness": 1,
                    "width": 2,
                },
                name=name,
                marker={"color": color},
            )
        )
    figure.update_yaxes(title_text="share of variance", rangemode="tozero")
    return styled(figure, 320).update_layout(barmode="group", hovermode="closest")


def over_time(
    output: Output, inputs: tuple[str, ...], total: np.ndarray, local: np.ndarray, most: int = 10
) -> go.Figure:
    """Total index (lines) and share by the exact gradient (points) along a step.

    **Arguments:** `total`, `local`: `(time, quantities)`.
    """
    size = np.nan_to_num(total).max(axis=0)
    figure = go.Figure()
    for number, place in enumerate(np.argsort(-size)[:most]):
        color = COLORS[number % len(COLORS)]
        for values, mode, name in ((total, "lines", inputs[place]), (local, "markers", f"{inputs[place]}, gradient")):
            figure.add_trace(
                go.Scatter(
                    x=output.axis,
                    y=values[:, place].astype(np.float32),
                    mode=mode,
                    name=name,
                    legendgroup=inputs[place],
                    showlegend=mode == "lines",
                    line={"color": color, "width": 1.8},
                    marker={"color": color, "size": 4},
                )
            )
    figure.update_xaxes(title_text=f"time after the step, {scaled(output).axis_unit}")
    figure.update_yaxes(title_text="share of variance", range=[0, 1.05])
    return styled(figure, 420).update_layout(legend={"orientation": "v", "x": 1.02, "y": 1}, hovermode="closest")
