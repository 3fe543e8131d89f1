"""What summaries and reports say of a model and of how it meets its traces, whatever found it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

import vgtjax
from vgtjax.estimation import SensorNoise, TraceResult
from vgtjax.experiments import HysteresisLoop, find_loop

from . import figures
from .component_figures import component_figures
from .files import finite

LOOP_POINTS = 1200


@dataclasses.dataclass(frozen=True, eq=False)
class LoopPair:
    """A measured loop and the simulated one, read at the same positions; `turbine` in Pa gauge."""

    result: TraceResult
    turbine: float
    measured: HysteresisLoop
    simulated: HysteresisLoop

    @property
    def widths(self) -> dict[str, float]:
        """Mean widths over 2 to 8 mm of travel in Pa."""
        return {"measured": self.measured.mean_width, "simulated": self.simulated.mean_width}


def loop_pair(result: TraceResult) -> LoopPair | None:
    """The loops of a trace that is one slow excursion with both signals measured, or `None`."""
    trace = result.trace
    if not trace.has_pairs:
        return None
    pair = figures.measured_pair(result)
    measured = find_loop(trace.on_one_clock().time, pair["x_d"], pair["p_act"])
    simulated = find_loop(trace.time, result.simulated["x_d"], result.simulated["p_act"])
    if measured is None or simulated is None:
        return None
    turbine = 0.0 if trace.p_trb is None else float(np.mean(trace.p_trb))
    return LoopPair(result, turbine, measured, simulated)


def loops_figure(pairs: Sequence[LoopPair]) -> go.Figure:
    """All slow loops in one picture, a colour for every turbine pressure; points are measured, lines simulated."""
    figure = go.Figure()
    for number, pair in enumerate(pairs):
        color = figures.PALETTE[number % len(figures.PALETTE)]
        at = f"{pair.turbine / 100:.0f} mbar at the turbine"
        loops = figures.loop_curves(pair.result, LOOP_POINTS)
        figure.add_trace(figures.points(*loops["measured"], f"{at}, measured", color, 3, opacity=0.3))
        figure.add_trace(figures.curve(*loops["simulated"], f"{at}, simulated", color, width=1.6))
    return figures.styled(figure, 520, figures.LABEL["p_act"], figures.LABEL["x_d"], hovermode="closest")


def model_sections(model: vgtjax.AbstractModel, results: list[TraceResult]) -> dict[str, Any]:
    """What reports show of a model: each trace, the slow loops, and each law."""
    traces = [trace_section(result) for result in results]
    laws = component_figures(model, [result.trace for result in results])
    return {"traces": traces, "loops": loop_section(results), "laws": laws}


def loop_section(results: list[TraceResult]) -> dict[str, Any] | None:
    """What a report shows of the slow loops among the traces, if there are any."""
    pairs = sorted((pair for result in results if (pair := loop_pair(result)) is not None), key=lambda p: p.turbine)
    return {"pairs": pairs, "figure": loops_figure(pairs)} if pairs else None


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
                "error": None if channel.error is None else float(np.max(channel.error)) * scale,
                "offset": channel.offset * scale,
                "peak": channel.peak * scale,
                "correlation": figures.autocorrelation(channel.residual, 1),
            }
        )
    return {
        "name": result.trace.name,
        "use": result.use,
        "notes": result.trace.notes,
        "channels": channels,
        "figure": figures.trace_figure(result),
        "loop": figures.loop_figure(result),
    }


def sensor_summary(sensors: Mapping[str, SensorNoise]) -> dict[str, Any]:
    """What a fit found out of the sensors of a trace, by channel, in SI units."""
    return {
        name: {"noise": sensor.level, "memory": sensor.memory.tolist(), "outliers": sensor.outliers}
        for name, sensor in sensors.items()
    }


def trace_summary(result: TraceResult) -> dict[str, Any]:
    """How a model meets one trace, in SI units, as summaries state it."""
    pair = loop_pair(result)
    return {
        "use": result.use,
        "rmse": finite(result.rmse),
        "offset": finite(result.offset),
        "noise": {name: channel.noise for name, channel in result.channels.items()},
        "peak": {name: finite(channel.peak) for name, channel in result.channels.items()},
        "correlation_of_neighbours": {
            name: finite(figures.autocorrelation(channel.residual, 1)) for name, channel in result.channels.items()
        },
        "largest_error": {
            name: finite(float(np.max(channel.error)))
            for name, channel in result.channels.items()
            if channel.error is not None
        },
        **({} if pair is None else {"loop_width": pair.widths, "loop_turbine_pressure": pair.turbine}),
        "notes": list(result.trace.notes),
    }
