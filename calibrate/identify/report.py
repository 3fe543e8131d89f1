"""The report of an identification: one section a bench test, and the traces with the model that came out."""

import dataclasses
from typing import Any

import numpy as np
import plotly.graph_objects as go

import vgtjax
from vgtjax.estimation import TraceResult
from vgtjax.identification import Curve, Identified

from ..output.component_figures import CURVES
from ..output.figures import MEASURED, styled, thin
from ..output.page import figure_html, render_page
from ..output.sections import component_sections, loop_section, trace_section
from ..resumable import Summaries
from ..study.parameter_file import Row
from ..study.units import Job

FEW = 100
"""Points below which each is worth a large mark."""


@dataclasses.dataclass(frozen=True, eq=False)
class UnitIdentification:
    """What the report says of one unit."""

    name: str | None
    model: vgtjax.AbstractModel
    found: list[Identified]
    table: list[Row]
    traces: list[TraceResult]
    seconds: float


def render(job: Job, unit: UnitIdentification) -> str:
    """The report of one unit as HTML, with plots, their library and the study inside."""
    return render_page(
        "identify.html.jinja",
        **job.heading(unit.name),
        unit=unit,
        sections=[_section(result, unit.table) for result in unit.found],
        traces=[trace_section(result) for result in unit.traces],
        loops=loop_section(unit.traces),
        components=component_sections(unit.model),
    )


def render_overview(job: Job, summaries: Summaries) -> str:
    """The report of a study with several units: what each one's tests determined, with a link to its own report."""
    names = [section["name"] for section in next(iter(summaries.values()))["sections"]]
    return render_page(
        "identify_overview.html.jinja",
        **job.heading(),
        names=names,
        units=summaries,
    )


def _section(result: Identified, table: list[Row]) -> dict[str, Any]:
    values = {}
    for name, value in result.values.items():
        errors = result.std_errors.get(name, np.full(np.shape(value), np.nan))
        for index, (number, error) in enumerate(zip(np.atleast_1d(value), np.atleast_1d(errors), strict=True)):
            entry = name if np.ndim(value) == 0 else f"{name}[{index}]"
            values[entry] = (float(number), float(error) if np.isfinite(error) else None)
    rows = [{"row": row, "value": values[row.entry]} for row in table if row.entry in values]
    titles = list(dict.fromkeys(curve.title for curve in result.figures))
    pictures = [_picture([curve for curve in result.figures if curve.title == title]) for title in titles]
    return {"result": result, "rows": rows, "figures": [figure_html(picture) for picture in pictures]}


def _picture(curves: list[Curve]) -> go.Figure:
    """Points and law of the curves that share a picture."""
    figure = go.Figure()
    for number, curve in enumerate(curves):
        color = CURVES[number % len(CURVES)]
        name = curve.name or "identified"
        few = len(curve.points[0]) < FEW
        measured = {
            "color": MEASURED if len(curves) == 1 else color,
            "size": 9 if few else 4,
            "opacity": 1.0 if few else 0.6,
        }
        order = np.argsort(curve.points[0], kind="stable")
        x, y = thin(*(np.asarray(values)[order] for values in curve.points))
        figure.add_trace(
            go.Scatter(
                x=x.astype(np.float32),
                y=y.astype(np.float32),
                mode="markers",
                name="measured",
                marker=measured,
                legendgroup=name,
                showlegend=len(curves) == 1,
            )
        )
        x, y = (np.asarray(values, np.float32) for values in curve.line)
        line = {"color": color, "width": 2}
        figure.add_trace(go.Scatter(x=x, y=y, mode="lines", name=name, line=line, legendgroup=name))
    figure.update_xaxes(title_text=curves[0].x_label)
    figure.update_yaxes(title_text=curves[0].y_label)
    return styled(figure, 380).update_layout(title=curves[0].title, margin={"t": 70}, hovermode="closest")
