"""The report of a comparison: one HTML file with the table of structures and what remains of the best."""

from typing import Any

import plotly.graph_objects as go

from vgtjax.identification import Compared

from ..output import figures
from ..output.page import render_page
from ..output.sections import model_sections
from ..resumable import Summaries
from ..study.units import Job
from .verdict import GREEDY, Verdict


def render(job: Job, unit: str | None, compared: Compared, verdict: Verdict, seconds: float) -> str:
    """The report of one unit as HTML."""
    assert compared.fit is not None, "a report needs a fit that may be used"
    calibration = compared.fit.calibration
    return render_page(
        "compare.html.jinja",
        **job.heading(unit),
        seconds=seconds,
        greedy=GREEDY,
        verdict=verdict,
        criterion=criterion_figure(verdict.table),
        **model_sections(calibration.model, calibration.traces),
        autocorrelation=figures.autocorrelation_figure(calibration.traces),
    )


def render_overview(job: Job, summaries: Summaries) -> str:
    """The report of a study with several units: what was chosen for each, with a link to its own report."""
    names = list(dict.fromkeys(name for summary in summaries.values() for name in summary.get("chosen", ())))
    return render_page("compare_overview.html.jinja", **job.heading(), names=names, units=summaries)


def criterion_figure(table: list[dict[str, Any]]) -> go.Figure:
    """By how much the criterion of every structure exceeds the best one's of its component."""
    rows = [row for row in table if row["criterion"] is not None]
    least = {row["component"]: row["criterion"] for row in reversed(rows)}
    names = [f"{row['component']}: {row['name']}" for row in rows]
    # A logarithmic axis has no zero; one is less than any evidence.
    worse = [max(row["criterion"] - least[row["component"]], 1.0) for row in rows]
    figure = go.Figure(go.Bar(x=worse, y=names, orientation="h", marker_color=figures.SIMULATED))
    figure.update_xaxes(type="log", exponentformat="power").update_yaxes(autorange="reversed")
    return figures.styled(figure, 120 + 26 * len(rows), "criterion above the best", margin={"l": 220})
