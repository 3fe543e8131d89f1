"""Hysteresis of measured and simulated loops, for summaries and reports."""

import dataclasses

import numpy as np
import plotly.graph_objects as go

from vgtjax.estimation import TraceResult
from vgtjax.experiments import HysteresisLoop, find_loop

from .figures import LABEL, SCALE, measured_pair, styled

PRESSURE_COLORS = ("#64748b", "#1d4ed8", "#c2410c", "#15803d", "#7c3aed")
POINTS = 1200


@dataclasses.dataclass(frozen=True, eq=False)
class LoopPair:
    """A measured loop and the simulated one, read at the same positions; `turbine` in Pa gauge."""

    name: str
    turbine: float
    measured: HysteresisLoop
    simulated: HysteresisLoop


def loop_pair(result: TraceResult) -> LoopPair | None:
    """The loops of a trace that is one slow excursion with both signals measured, or `None`."""
    trace = result.trace
    if trace.x_d is None or trace.p_act is None:
        return None
    seen = measured_pair(result)
    measured = find_loop(trace.on_one_clock().time, seen["x_d"], seen["p_act"])
    simulated = find_loop(trace.time, result.simulated["x_d"], result.simulated["p_act"])
    if measured is None or simulated is None:
        return None
    turbine = 0.0 if trace.p_trb is None else float(np.mean(trace.p_trb))
    return LoopPair(trace.name, turbine, measured, simulated)


def loop_widths(result: TraceResult) -> dict[str, float] | None:
    """Mean widths over 2 to 8 mm of travel in Pa, measured and simulated."""
    pair = loop_pair(result)
    if pair is None:
        return None
    return {"measured": pair.measured.mean_width, "simulated": pair.simulated.mean_width}


def loops_figure(results: list[TraceResult]) -> go.Figure | None:
    """All slow loops in one picture, a colour for every turbine pressure; points are measured, lines simulated."""
    shown = [(result, pair) for result in results if (pair := loop_pair(result)) is not None]
    if not shown:
        return None
    figure = go.Figure()
    for number, (result, pair) in enumerate(sorted(shown, key=lambda item: item[1].turbine)):
        trace, color = result.trace, PRESSURE_COLORS[number % len(PRESSURE_COLORS)]
        name = f"{pair.turbine / 100:.0f} mbar"
        points, line = {"color": color, "size": 3, "opacity": 0.3}, {"color": color, "width": 1.6}
        for kind, values, style in (
            ("measured", measured_pair(result), {"mode": "markers", "marker": points}),
            ("simulated", result.simulated, {"mode": "lines", "line": line}),
        ):
            stride = -(-len(values["x_d"]) // POINTS)
            gauge = (values["p_act"] - trace.atmosphere)[::stride] * SCALE["p_act"]
            position = values["x_d"][::stride] * SCALE["x_d"]
            figure.add_trace(
                go.Scatter(
                    x=gauge.astype(np.float32),
                    y=position.astype(np.float32),
                    name=f"{name} at the turbine, {kind}",
                    **style,
                )
            )
    figure.update_xaxes(title_text=LABEL["p_act"])
    figure.update_yaxes(title_text=LABEL["x_d"])
    return styled(figure, 520).update_layout(hovermode="closest")
