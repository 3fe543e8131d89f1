"""The report of a sensitivity study: one HTML file that carries all it shows."""

from typing import Any

from ..output.page import figure_html, render_page
from ..population import PopulationJob
from . import figures
from .analysis import Analysis


def render(job: PopulationJob, analysis: Analysis, summary: dict[str, Any]) -> str:
    """The report as HTML."""
    threshold = job.study.sensitivity.threshold
    return render_page(
        "sensitivity.html.jinja",
        **job.heading(),
        summary=summary,
        overview=figure_html(figures.overview(tuple(analysis.rankings.values()), threshold)),
        outputs=[
            {"name": ranking.output, "figure": figure_html(figures.bars(ranking)), "shown": _shown(summary, ranking)}
            for ranking in analysis.rankings.values()
        ],
        over_time=[
            {
                "title": output.meaning,
                "figure": figure_html(
                    figures.over_time(
                        output,
                        analysis.inputs,
                        analysis.seen(output, analysis.indices.total.value),
                        analysis.seen(output, analysis.local),
                    )
                ),
            }
            for output in analysis.outputs
            if output.axis
        ],
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
