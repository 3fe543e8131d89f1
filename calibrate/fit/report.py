"""The report of a fit: one HTML file that carries all it shows."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from vgtjax.estimation import REACHED, StartEnded, found_besides

from ..output import figures
from ..output.page import render_page
from ..output.sections import model_sections
from ..resumable import Summaries
from ..study.models import passivity_note, taken_for_exact
from ..study.parameter_file import Entry, by_entry, start_as_study
from ..study.units import Job, Unit
from .around import slices_figure
from .budget import budget_rows
from .decisions import decisions
from .outcome import Fitted
from .posterior import rows
from .terminal import verdict


def render(job: Job, unit: Unit, fitted: Fitted, table: list[Entry]) -> str:
    """The report of one unit as HTML, with plots, their library and the study inside."""
    calibration, around = fitted.calibration, fitted.around
    known = calibration.uncertainty.estimable
    entries = [e for e, is_known in zip(calibration, known, strict=True) if is_known]
    covariance = calibration.covariance[np.ix_(known, known)]
    cost, sources = 2 * np.asarray(calibration.progress.history), list(calibration.budget.moved)
    return render_page(
        "fit.html.jinja",
        **job.heading(unit.name),
        hashes=unit.hashes,
        fit=calibration,
        certificate=fitted.certificate,
        seconds=round(fitted.seconds, 3),  # as the summary has it
        not_estimable=fitted.not_estimable,
        sentence=verdict(fitted, table),
        before=fitted.known_before,
        table=table,
        start=start_as_study(calibration),
        besides=[*found_besides(calibration), *taken_for_exact(calibration.task)],
        budget=budget_rows(calibration),
        sources=sources,
        parts=[
            "value of",
            "A: noise",
            "A: scatter",
            *(f"B: {source}" for source in sources),
            "combined",
            "unit",
            "noise by windows",
        ],
        decisions=decisions(fitted, table),
        shifts=dict(zip(calibration, calibration.shifts.tolist(), strict=True)),
        passivity=passivity_note(calibration.model),
        **model_sections(calibration.model, calibration.traces),
        convergence=figures.convergence_figure(cost, "chi^2 / N"),
        autocorrelation=figures.autocorrelation_figure(calibration.traces),
        waterfall=waterfall_figure(calibration.progress.ends) if calibration.progress.waterfall else None,
        around=around,
        posterior=fitted.posterior,
        posterior_rows=[] if fitted.posterior is None else rows(fitted.posterior, calibration),
        slices=None if around is None else slices_figure(around.slices),
        correlation=figures.correlation_figure(entries, covariance) if len(entries) > 1 else None,
    )


def waterfall_figure(ends: Sequence[StartEnded]) -> go.Figure:
    """The cost at the end of every start, the least first."""
    ranked = sorted((2 * each.cost, each.status) for each in ends if each.cost is not None)
    figure, colors = go.Figure(), dict.fromkeys(REACHED, figures.SIMULATED)
    colors |= {"hopeless": figures.MEASURED, "stuck": figures.DUTY}
    for status, color in colors.items():
        places = [(place, chi2) for place, (chi2, said) in enumerate(ranked, 1) if said == status]
        if places:
            x, y = np.transpose(places)
            figure.add_trace(figures.points(x, y, status, color, 7))
    figures.styled(figure, 320, "start, by its end", "chi^2 / N", hovermode="closest")
    return figure.update_yaxes(type="log", exponentformat="power")


def render_overview(job: Job, summaries: Summaries, population: dict[str, dict[str, Any]]) -> str:
    """The report of a study with several units: how each was met, how they differ, and links to their own reports.

    `population` has the parameters of `parameters.json` by unit.
    """
    return render_page(
        "fit_overview.html.jinja",
        **job.heading(),
        units=[_overview_row(str(name), summary) for name, summary in summaries.items()],
        parameters=_spread(population),
    )


def _overview_row(name: str, summary: dict[str, Any]) -> dict[str, Any]:
    """One unit in a line: its worst trace counts."""
    traces = summary["traces"].values()
    widths = [trace["loop_width"] for trace in traces if "loop_width" in trace]

    def worst(channel: str, scale: float) -> float | None:
        found = [trace["rmse"][channel] * scale for trace in traces if trace["rmse"].get(channel) is not None]
        return max(found, default=None)

    return {
        "name": name,
        "summary": summary,
        "x_d": worst("x_d", 1e6),
        "p_act": worst("p_act", 1.0),
        "loop": max((100 * abs(width["simulated"] / width["measured"] - 1) for width in widths), default=None),
        "widths": [width["measured"] / 100 for width in widths],
    }


def _spread(population: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """How each fitted entry differs from unit to unit, beside the standard error of one unit."""
    found: dict[str, list[tuple[float, float | None, str]]] = {}
    for parameters in population.values():
        for name, fields in parameters.items():
            columns = [by_entry({name: fields[key]}) for key in ("value", "std_error", "unit", "free")]
            for entry in columns[0]:
                value, error, unit, free = (column[entry] for column in columns)
                if free and value is not None:
                    found.setdefault(entry, []).append((value, error, unit))
    return [_spread_row(entry, numbers) for entry, numbers in found.items()]


def _spread_row(entry: str, found: list[tuple[float, float | None, str]]) -> dict[str, Any]:
    values = np.array([value for value, _, _ in found])
    errors = [error for _, error, _ in found if error is not None]
    return {
        "entry": entry,
        "unit": found[0][2],
        "mean": float(values.mean()),
        "deviation": float(values.std(ddof=1)) if len(values) > 1 else None,
        "low": float(values.min()),
        "high": float(values.max()),
        "error": float(np.median(errors)) if errors else None,
    }
