"""The report of a check: what traces can tell, in words, numbers and a picture."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from vgtjax.assurance import Gain, Information

from ...output import figures
from ...output.page import render_page
from ...resumable import Summaries
from ...study.units import Job


def render(
    job: Job,
    unit: str | None,
    known: Information | None,
    gains: list[Gain],
    sentences: Sequence[str],
    exact: Sequence[str],
    seconds: float,
) -> str:
    """The report of one unit as HTML: what traces can't tell in `sentences`, and what errors take for `exact`."""
    errors = {} if known is None else known.errors
    return render_page(
        "check.html.jinja",
        **job.heading(unit),
        seconds=seconds,
        known=known,
        sentences=sentences,
        exact=exact,
        errors=sorted(errors.items(), key=lambda pair: -pair[1]),
        gains=[gain.summary() for gain in gains],
        figure=errors_figure(errors) if errors else None,
        inf=np.inf,
    )


def render_overview(job: Job, summaries: Summaries) -> str:
    """The report of a study with several units."""
    return render_page("check_overview.html.jinja", **job.heading(), units=summaries)


def errors_figure(errors: dict[str, float]) -> go.Figure:
    """Expected relative errors in percent; what is not estimable reaches the edge."""
    ranked = sorted(errors.items(), key=lambda pair: -pair[1])
    known = [100 * error for _, error in ranked if np.isfinite(error)]
    edge = 10 * max(known, default=1.0)
    sizes = [100 * error if np.isfinite(error) else edge for _, error in ranked]
    colors = [figures.SIMULATED if np.isfinite(error) else figures.MEASURED for _, error in ranked]
    figure = go.Figure(go.Bar(x=sizes, y=[name for name, _ in ranked], orientation="h", marker_color=colors))
    figure.update_xaxes(type="log", exponentformat="power").update_yaxes(autorange="reversed")
    return figures.styled(figure, 120 + 20 * len(ranked), "expected relative error, %", margin={"l": 260})
