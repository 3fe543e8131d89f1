"""The report of an identification: one section a bench test, and the traces with the model that came out."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

from vgtjax.identification import Curve, Identified

from ..output.figures import MEASURED, PALETTE, curve, points, styled
from ..output.files import finite
from ..output.page import render_page
from ..resumable import Summaries
from ..study.parameter_file import Entry, by_entry
from ..study.units import Job

FEW = 100
"""Points below which each is worth a large mark."""


def render(
    job: Job, unit: str | None, found: list[Identified], table: list[Entry], seconds: float, model: dict[str, Any]
) -> str:
    """The report of one unit as HTML, with plots, their library and the study inside.

    **Arguments:** `model`: the sections on the model that came out.
    """
    sections = [_section(result, table) for result in found]
    return render_page("identify.html.jinja", **job.heading(unit), seconds=seconds, sections=sections, **model)


def render_overview(job: Job, summaries: Summaries) -> str:
    """The report of a study with several units: what each one's tests determined, with a link to its own report."""
    units = {
        unit: {"seconds": summary["wall_seconds"], "told": {s["name"]: len(s["values"]) for s in summary["sections"]}}
        for unit, summary in summaries.items()
    }
    names = dict.fromkeys(name for unit in units.values() for name in unit["told"])  # not every unit has every test
    return render_page("identify_overview.html.jinja", **job.heading(), names=list(names), units=units)


def _section(result: Identified, table: list[Entry]) -> dict[str, Any]:
    values, errors = by_entry(result.values), by_entry(result.std_errors)
    rows = [
        {"entry": entry, "value": float(values[entry.name]), "error": finite(errors.get(entry.name, np.nan))}
        for entry in table
        if entry.name in values
    ]
    titles = dict.fromkeys(curve.title for curve in result.figures)
    pictures = [_picture([curve for curve in result.figures if curve.title == title]) for title in titles]
    return {"result": result, "rows": rows, "figures": pictures}


def _picture(curves: list[Curve]) -> go.Figure:
    """Points and law of the curves that share a picture."""
    figure, alone = go.Figure(), len(curves) == 1
    for number, law in enumerate(curves):
        color, name = PALETTE[number % len(PALETTE)], law.name or "identified"
        size, opacity = (9, 1.0) if len(law.points[0]) < FEW else (4, 0.6)
        order = np.argsort(law.points[0], kind="stable")
        x, y = (np.asarray(values)[order] for values in law.points)
        figure.add_trace(
            points(
                x,
                y,
                "measured",
                MEASURED if alone else color,
                size,
                opacity=opacity,
                legendgroup=name,
                showlegend=alone,
            )
        )
        figure.add_trace(curve(*law.line, name, color, width=2))
    styled(figure, 380, curves[0].x_label, curves[0].y_label, margin={"t": 70}, hovermode="closest")
    return figure.update_layout(title=curves[0].title)
