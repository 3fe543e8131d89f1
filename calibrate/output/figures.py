"""Figures of a report (plotly), in the units of the bench: s, mbar gauge, mm."""

import itertools
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.estimation import NORMAL_95, Comparison, TraceResult

MEASURED, SIMULATED, DUTY, REFERENCE = "#9aa5b1", "#c2410c", "#64748b", "#475569"
PALETTE = ("#c2410c", "#1d4ed8", "#15803d", "#7c3aed", "#0e7490", "#b45309", "#be185d", "#4d7c0f", "#334155", "#a16207")
"""Where several curves share a picture."""
POINTS = 1500
"""Pairs of points a curve; extremes are kept, so no spike is lost."""
SCALE = {"x_d": 1e3, "p_act": 1e-2}
LABEL = {"x_d": "position, mm", "p_act": "pressure, mbar gauge"}
RESIDUAL = {"x_d": ("residual, um", 1e6), "p_act": ("residual, Pa", 1.0)}


def thin(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve with fewer points that looks the same: the lowest and the highest sample of every bucket."""
    width = -(-len(values) // POINTS)
    if width <= 2:
        return time, values
    whole = len(values) // width * width
    buckets = values[:whole].reshape(-1, width)
    first = np.arange(len(buckets)) * width
    kept = np.concatenate([first + buckets.argmin(1), first + buckets.argmax(1), np.arange(whole, len(values))])
    kept = np.unique(np.concatenate([[0], kept, [len(values) - 1]]))
    return time[kept], values[kept]


def curve(
    x: Any, y: Any, name: str, color: str, *, width: float = 1.2, dash: str = "solid", **style: Any
) -> go.Scatter:
    """A thinned line; the legend switches curves of one name together."""
    x, y = thin(np.asarray(x), np.asarray(y))  # times may count from 1970, of which half the digits tell no sample
    line = {"color": color, "width": width, "dash": dash}
    return go.Scatter(
        x=x, y=y.astype(np.float32), name=name, line=line, **{"mode": "lines", "legendgroup": name, **style}
    )


def points(
    x: Any, y: Any, name: str, color: str, size: float, *, symbol: str = "circle", opacity: float = 1.0, **style: Any
) -> go.Scatter:
    """Marks where `curve` draws a line."""
    marker = {"color": color, "size": size, "symbol": symbol, "opacity": opacity}
    return curve(x, y, name, color, mode="markers", marker=marker, **style)


def styled(figure: go.Figure, height: int, x: str = "", y: str = "", **layout: Any) -> go.Figure:
    """The look that all figures of a report share, and the titles of its axes."""
    figure.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 30, "b": 45},
        font={"family": "system-ui, sans-serif", "size": 12},
        legend={"orientation": "h", "y": 1.06, "x": 0},
        hovermode="x unified",
    )
    if x:
        figure.update_xaxes(title_text=x)
    if y:
        figure.update_yaxes(title_text=y)
    return figure.update_layout(**layout)


def numbered(figure: go.Figure, count: int) -> None:
    """Ticks at whole numbers along an axis that counts so many things."""
    figure.update_xaxes(tick0=0, dtick=max(1, round(count / 10)))


def _shown(channel: str, values: np.ndarray, atmosphere: float) -> np.ndarray:
    return (values - (atmosphere if channel == "p_act" else 0.0)) * SCALE[channel]


def trace_figure(result: TraceResult) -> go.Figure:
    """Measured against simulated, residuals below each signal, the duty at the bottom. Sensor offsets removed."""
    trace, channels = result.trace, result.channels
    rows = 2 * len(channels) + (trace.pwm is not None)
    heights = [3, 1.2] * len(channels) + [1] * (trace.pwm is not None)
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.035, row_heights=heights)
    for number, (name, channel) in enumerate(channels.items()):
        row = 2 * number + 1
        for kind, values, color in (
            ("measured", channel.measured - channel.offset, MEASURED),
            ("simulated", channel.simulated, SIMULATED),
        ):
            shown = _shown(name, values, trace.atmosphere)
            figure.add_trace(curve(channel.time, shown, kind, color, showlegend=number == 0), row=row, col=1)
        label, scale = RESIDUAL[name]
        residual = curve(channel.time, channel.residual * scale, "residual", MEASURED, width=0.7, showlegend=False)
        figure.add_trace(residual, row=row + 1, col=1)
        for band in _band(channel, scale, shown=number == 0):
            figure.add_trace(band, row=row + 1, col=1)
        figure.update_yaxes(title_text=LABEL[name], row=row, col=1)
        figure.update_yaxes(title_text=label, row=row + 1, col=1)
    if trace.pwm is not None:
        shape = "hv" if trace.duty_hold == "zero-order" else "linear"
        duty = curve(trace.channels["pwm"].time, trace.pwm, "duty", DUTY, line_shape=shape, showlegend=False)
        figure.add_trace(duty, row=rows, col=1)
        figure.update_yaxes(title_text="duty, %", row=rows, col=1)
    figure.update_xaxes(title_text="time, s", row=rows, col=1)
    return styled(figure, round(75 * sum(heights)))


def _band(channel: Comparison, scale: float, *, shown: bool) -> list[go.Scatter]:
    """Where 95 % of what the parameters' errors leave open lies, around the simulated signal."""
    if channel.error is None or not np.all(np.isfinite(channel.error)):
        return []
    reach = NORMAL_95 * scale * channel.error
    style: dict[str, Any] = {"width": 0.8, "hoverinfo": "skip"}
    low = curve(channel.time, -reach, "95 % by parameters", SIMULATED, showlegend=False, **style)
    high = curve(channel.time, reach, "95 % by parameters", SIMULATED, showlegend=shown, fill="tonexty", **style)
    return [low, high]


def loop_figure(result: TraceResult) -> go.Figure:
    """Position over chamber pressure: the hysteresis loop. Sensor offsets removed."""
    loops = loop_curves(result, 2 * POINTS)
    colors = {"measured": MEASURED, "simulated": SIMULATED}
    figure = go.Figure([curve(*loop, kind, colors[kind]) for kind, loop in loops.items()])
    return styled(figure, 420, LABEL["p_act"], LABEL["x_d"], hovermode="closest")


def loop_curves(result: TraceResult, most: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Pressure and position as shown, measured and simulated: at most so many samples of each, equally spaced."""
    loops = {}
    for kind, values in (("measured", measured_pair(result)), ("simulated", result.simulated)):
        stride = -(-len(values["x_d"]) // most)
        pressure, position = (_shown(n, values[n], result.trace.atmosphere)[::stride] for n in ("p_act", "x_d"))
        loops[kind] = (pressure, position)
    return loops


def measured_pair(result: TraceResult) -> dict[str, np.ndarray]:
    """Position and pressure at the same times without their sensors' offsets; simulated where one was not measured."""
    trace = result.trace.on_one_clock()
    pair = {}
    for name, simulated in result.simulated.items():
        values = trace.at(name)
        simulated = np.interp(trace.time, result.trace.time, simulated)
        pair[name] = simulated if values is None else values - result.offset.get(name, 0.0)
    return pair


def convergence_figure(history: Any, title: str, color: str = SIMULATED) -> go.Figure:
    """Cost after every step."""
    figure = go.Figure(curve(np.arange(len(history)), history, "", color, mode="lines+markers"))
    figure.update_yaxes(type="log", exponentformat="power")
    return styled(figure, 300, "step", title)


def autocorrelation_figure(results: list[TraceResult]) -> go.Figure:
    """Autocorrelation of the residuals of each trace: white residuals stay inside the band."""
    figure = make_subplots(rows=1, cols=2, subplot_titles=("position", "pressure"))
    for result, color in zip(results, itertools.cycle(PALETTE), strict=False):
        for column, channel in enumerate(("x_d", "p_act"), 1):
            if channel in result.channels:
                residual = result.channels[channel].residual
                lags = np.arange(1, min(51, len(residual)))
                rho = [autocorrelation(residual, int(lag)) for lag in lags]
                line = curve(lags, rho, result.trace.name, color, width=2, showlegend=column == 1)
                figure.add_trace(line, row=1, col=column)
    for column in (1, 2):
        shortest = min(len(channel.time) for result in results for channel in result.channels.values())
        bound = NORMAL_95 / np.sqrt(shortest)
        figure.add_hrect(-bound, bound, fillcolor="#94a3b8", opacity=0.2, line_width=0, row=1, col=column)
    figure.update_yaxes(title_text="autocorrelation", row=1, col=1)
    return styled(figure, 340, "lag, samples", margin={"t": 70})


def autocorrelation(residual: np.ndarray, lag: int) -> float:
    """Autocorrelation of a residual at a lag in samples."""
    centred = residual - residual.mean()
    return float(centred[lag:] @ centred[:-lag] / (centred @ centred))


def correlation_figure(entries: list[str], covariance: np.ndarray) -> go.Figure:
    """How the estimates of the parameters hang together."""
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    figure = heatmap(correlation, entries, entries, "correlation", zmin=-1, colorscale="RdBu")
    return styled(figure, 260 + 18 * len(entries), hovermode="closest", margin={"l": 240, "b": 220, "t": 20})


def heatmap(values: np.ndarray, columns: Any, rows: Any, title: str, **style: Any) -> go.Figure:
    """Numbers up to one as colours; the first row is on top."""
    figure = go.Figure(
        go.Heatmap(z=values.astype(np.float32), x=columns, y=rows, zmax=1, colorbar={"title": title}, **style)
    )
    return figure.update_yaxes(autorange="reversed")
