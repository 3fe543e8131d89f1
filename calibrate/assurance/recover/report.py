"""The report of a recovery: bias, coverage and true spread of every parameter beside the claimed ones."""

import numpy as np
import plotly.graph_objects as go

from vgtjax.assurance import Recovery
from vgtjax.estimation import NORMAL_95

from ...output import figures
from ...output.page import render_page
from ...resumable import Summaries
from ...study.units import Job


def render(job: Job, unit: str | None, recovery: Recovery, campaigns: int, seconds: float) -> str:
    """The report of one unit as HTML."""
    rows = zip(
        recovery.entries,
        recovery.known.astype(int).tolist(),
        *(_cells(each) for each in (recovery.coverage, recovery.bias / recovery.claimed)),
        *(_cells(each) for each in (recovery.spread, recovery.claimed, recovery.spread / recovery.claimed)),
        strict=True,
    )
    return render_page(
        "recover.html.jinja",
        **job.heading(unit),
        recovery=recovery,
        campaigns=campaigns,
        seconds=seconds,
        rows=list(rows),
        figure=errors_figure(recovery),
    )


def render_overview(job: Job, summaries: Summaries) -> str:
    """The report of a study with several units."""
    return render_page("recover_overview.html.jinja", **job.heading(), units=summaries)


def _cells(values: np.ndarray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def errors_figure(recovery: Recovery) -> go.Figure:
    """Errors of all estimates in claimed standard errors, a column of points each entry."""
    figure = go.Figure()
    for number, name in enumerate(recovery.entries):
        points = recovery.scores[:, number]
        figure.add_trace(figures.points(np.full(len(points), number), points, name, figures.MEASURED, 4, opacity=0.5))
    for edge in (-NORMAL_95, NORMAL_95):
        figure.add_hline(y=edge, line_dash="dash", line_color=figures.SIMULATED)
    figures.styled(figure, 460, "", "error / claimed standard error", hovermode="closest", margin={"b": 200})
    figure.update_xaxes(tickvals=list(range(len(recovery.entries))), ticktext=list(recovery.entries), tickangle=60)
    return figure.update_layout(showlegend=False).update_yaxes(range=[-6, 6])
