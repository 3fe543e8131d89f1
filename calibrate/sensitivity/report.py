"""The report of a sensitivity study: one HTML file that carries all it shows."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

from vgtjax.experiments import Output
from vgtjax.sensitivity import Interval, RankedInput, Ranking

from ..output.figures import PALETTE, curve, heatmap, points, styled
from ..output.page import render_page
from ..population import PopulationJob, scaled
from .analysis import Analysis

KINDS = (
    ("correlation", "SRC (4.1)", "#94a3b8"),
    ("regression", "regression, squared", "#64748b"),
    ("first", "first order", "#1d4ed8"),
    ("total", "total", "#c2410c"),
    ("local", "gradient", "#15803d"),
)
SHOWN = 6
"""Quantities in a bar chart; the rest is in the table."""


def render(job: PopulationJob, analysis: Analysis, summary: dict[str, Any]) -> str:
    """The report as HTML."""
    rankings = analysis.rankings.outputs
    return render_page(
        "sensitivity.html.jinja",
        **job.heading(),
        summary=summary,
        overview=_overview(rankings, job.study.sensitivity.threshold),
        outputs=[(ranking.output, _bars(ranking), _shown(summary, ranking)) for ranking in rankings],
        over_time=[(each.meaning, _over_time(analysis, each)) for each in analysis.outputs if each.axis],
    )


def _shown(summary: dict[str, Any], ranking: Any) -> list[dict[str, Any]]:
    """Rows of an output's table: what matters by any index, and three more."""
    rows = summary["outputs"][ranking.output]["quantities"]
    threshold = summary["threshold"]

    def size(row: dict[str, Any]) -> float:
        shares = [row[kind]["value"] for kind in ("src_thesis", "first", "total")] + [row["gradient"]]
        return max((share for share in shares if share is not None), default=0.0)

    mattering = sum(size(row) > threshold for row in rows)
    return [row for number, row in enumerate(rows) if size(row) > threshold or number < mattering + 3]


def _overview(rankings: tuple[Ranking, ...], threshold: float) -> go.Figure:
    """Total index of every output by every quantity that matters anywhere."""
    totals = [{entry.name: entry.total.value for entry in ranking.inputs} for ranking in rankings]
    names = sorted(
        {name for row in totals for name, value in row.items() if value > threshold},
        key=lambda name: -sum(np.nan_to_num(row[name]) for row in totals),
    )
    values = np.array([[row[name] for name in names] for row in totals])
    outputs = [ranking.output for ranking in rankings]
    figure = heatmap(values, names, outputs, "total", zmin=0, colorscale="Oranges", texttemplate="%{z:.2f}")
    return styled(figure, 200 + 22 * len(rankings), margin={"l": 230, "b": 190}, hovermode="closest")


def _bars(ranking: Ranking) -> go.Figure:
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
    figure.update_yaxes(rangemode="tozero")
    return styled(figure, 320, y="share of variance", barmode="group", hovermode="closest")


def _over_time(analysis: Analysis, output: Output, most: int = 10) -> go.Figure:
    """Total index (lines) and share by the exact gradient (points) along a step."""
    total, local = (analysis.above_noise(output, shares) for shares in (analysis.indices.total.value, analysis.local))
    size = np.nan_to_num(total).max(axis=0)
    figure = go.Figure()
    for number, place in enumerate(np.argsort(-size)[:most]):
        name, color = analysis.indices.inputs[place], PALETTE[number % len(PALETTE)]
        figure.add_trace(curve(output.axis, total[:, place], name, color, width=1.8))
        local_name, style = f"{name}, gradient", {"legendgroup": name, "showlegend": False}
        figure.add_trace(points(output.axis, local[:, place], local_name, color, 4, **style))
    figure.update_yaxes(range=[0, 1.05])
    legend, x = {"orientation": "v", "x": 1.02, "y": 1}, f"time after the step, {scaled(output).axis_unit}"
    return styled(figure, 420, x, "share of variance", legend=legend, hovermode="closest")
