"""The report of a fit: one HTML file that carries all it shows."""

import dataclasses
import datetime
import importlib.metadata
import platform
from typing import Any

import jinja2
import numpy as np
import plotly.graph_objects as go
import plotly.offline

from vgtjax.estimation import Calibration, TraceResult

from . import figures
from .job import Job
from .parameter_file import Row, start_as_study

_PACKAGES = ("vgtjax", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy")


@dataclasses.dataclass(frozen=True, eq=False)
class UnitReport:
    """What a report says of one unit."""

    name: str | None
    calibration: Calibration
    rows: list[Row]
    seconds: float
    unseen: list[str]
    """Free parameters that the traces did not determine at the start values."""


def render(job: Job, units: list[UnitReport]) -> str:
    """The report as HTML, with plots, their library and the study inside."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("calibrate"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = _number
    return environment.get_template("fit.html.jinja").render(
        title=job.study.name,
        study=job.study,
        study_text=job.text,
        fingerprint=job.fingerprint,
        date=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"),
        versions={name: importlib.metadata.version(name) for name in _PACKAGES},
        python=platform.python_version(),
        machine=platform.machine(),
        plotly=plotly.offline.get_plotlyjs(),
        units=[_sections(unit) for unit in units],
    )


def _sections(unit: UnitReport) -> dict[str, Any]:
    calibration = unit.calibration
    known = calibration.uncertainty.identifiable
    entries = [e for e, seen in zip(calibration.task.selection.entries, known, strict=True) if seen]
    covariance = calibration.covariance[np.ix_(known, known)]
    return {
        "name": unit.name,
        "calibration": calibration,
        "seconds": unit.seconds,
        "unseen": unit.unseen,
        "rows": unit.rows,
        "start": start_as_study(calibration),
        "traces": [_trace(result) for result in calibration.traces],
        "convergence": _html(figures.convergence_figure(calibration.progress)),
        "autocorrelation": _html(figures.autocorrelation_figure(calibration.traces)),
        "correlation": _html(figures.correlation_figure(entries, covariance)) if len(entries) > 1 else "",
    }


def _trace(result: TraceResult) -> dict[str, Any]:
    channels = []
    for channel, rmse in result.rmse.items():
        residual = getattr(result.trace, channel) - result.simulated[channel]
        unit, scale = ("um", 1e6) if channel == "x_d" else ("Pa", 1.0)
        channels.append(
            {
                "name": channel,
                "unit": unit,
                "rmse": rmse * scale,
                "noise": result.noise[channel] * scale,
                "offset": result.offset[channel] * scale,
                "peak": float(np.max(np.abs(residual - result.offset[channel]))) * scale,
                "correlation": figures.autocorrelation(residual, 1),
            }
        )
    return {
        "name": result.trace.name,
        "use": result.use,
        "notes": result.trace.notes,
        "channels": channels,
        "figure": _html(figures.trace_figure(result)),
        "loop": _html(figures.loop_figure(result)),
    }


def _html(figure: go.Figure) -> str:
    return figure.to_html(full_html=False, include_plotlyjs=False, config={"displaylogo": False, "responsive": True})


def _number(value: float | None, digits: int = 5) -> str:
    return "" if value is None else f"{value:.{digits}g}"
