"""What summaries and reports say of a model and of how it meets its traces, whatever found it."""

import math
from typing import Any

import numpy as np

import vgtjax
from vgtjax.estimation import TraceResult

from . import figures
from .component_figures import component_figures
from .hysteresis import loop_pair, loop_widths, loops_figure
from .page import figure_html


def component_sections(model: vgtjax.AbstractModel) -> list[dict[str, str]]:
    """Title and picture of each law of a model."""
    return [{"title": title, "figure": figure_html(figure)} for title, figure in component_figures(model)]


def loop_section(results: list[TraceResult]) -> dict[str, Any] | None:
    """What a report shows of the slow loops among the traces, if there are any: widths in mbar, and one picture."""
    figure = loops_figure(results)
    if figure is None:
        return None
    pairs = sorted((pair for result in results if (pair := loop_pair(result)) is not None), key=lambda p: p.turbine)
    rows = [
        {
            "name": pair.name,
            "turbine": pair.turbine / 100,
            "measured": pair.measured.mean_width / 100,
            "simulated": pair.simulated.mean_width / 100,
            "difference": 100 * (pair.simulated.mean_width / pair.measured.mean_width - 1),
        }
        for pair in pairs
    ]
    return {"rows": rows, "figure": figure_html(figure)}


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

    def finite(values: dict[str, float]) -> dict[str, float | None]:
        return {channel: value if math.isfinite(value) else None for channel, value in values.items()}

    widths = loop_widths(result)
    return {
        "use": result.use,
        "rmse": finite(result.rmse),
        "offset": finite(result.offset),
        "noise": {name: channel.noise for name, channel in result.channels.items()},
        **({} if widths is None else {"loop_width": widths}),
        "notes": list(result.trace.notes),
    }
