"""What summaries and reports say of a model and of how it meets its traces, whatever found it."""

from typing import Any

import numpy as np

import vgtjax
from vgtjax.estimation import TraceResult

from . import figures
from .component_figures import component_figures
from .files import finite
from .hysteresis import loop_pair, loops_figure
from .page import figure_html


def model_sections(model: vgtjax.AbstractModel, results: list[TraceResult]) -> dict[str, Any]:
    """What reports show of a model: each trace, the slow loops, and each law."""
    laws = [{"title": title, "figure": figure_html(figure)} for title, figure in component_figures(model)]
    return {"traces": [trace_section(result) for result in results], "loops": loop_section(results), "laws": laws}


def loop_section(results: list[TraceResult]) -> dict[str, Any] | None:
    """What a report shows of the slow loops among the traces, if there are any: widths in mbar, and one picture."""
    pairs = sorted((pair for result in results if (pair := loop_pair(result)) is not None), key=lambda p: p.turbine)
    rows = [
        {
            "name": pair.result.trace.name,
            "turbine": pair.turbine / 100,
            **{kind: width / 100 for kind, width in pair.widths.items()},
            "difference": 100 * (pair.simulated.mean_width / pair.measured.mean_width - 1),
        }
        for pair in pairs
    ]
    return {"rows": rows, "figure": figure_html(loops_figure(pairs))} if pairs else None


def trace_section(result: TraceResult) -> dict[str, Any]:
    """What a report shows of one trace: numbers of each channel, and pictures."""
    channels = []
    for name, channel in result.channels.items():
        unit, scale = ("um", 1e6) if name == "x_d" else ("Pa", 1.0)
        channels.append(
            {
                "name": name,
                "unit": unit,
                "rmse": channel.rmse * scale,
                "noise": channel.noise * scale,
                "offset": channel.offset * scale,
                "peak": float(np.max(np.abs(channel.residual))) * scale,
                "correlation": figures.autocorrelation(channel.residual, 1),
            }
        )
    return {
        "name": result.trace.name,
        "use": result.use,
        "notes": result.trace.notes,
        "channels": channels,
        "figure": figure_html(figures.trace_figure(result)),
        "loop": figure_html(figures.loop_figure(result)),
    }


def trace_summary(result: TraceResult) -> dict[str, Any]:
    """How a model meets one trace, in SI units, as summaries state it."""

    pair = loop_pair(result)
    return {
        "use": result.use,
        "rmse": finite(result.rmse),
        "offset": finite(result.offset),
        "noise": {name: channel.noise for name, channel in result.channels.items()},
        **({} if pair is None else {"loop_width": pair.widths}),
        "notes": list(result.trace.notes),
    }
