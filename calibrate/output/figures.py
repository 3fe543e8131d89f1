"""Figures of a report (plotly), in the units of the bench: s, mbar gauge, mm."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.estimation import Progress, TraceResult

MEASURED, SIMULATED, DUTY = "#9aa5b1", "#c2410c", "#64748b"
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


def _line(time: np.ndarray, values: np.ndarray, color: str, name: str, **style: object) -> go.Scatter:
    x, y = thin(time, values)
    return go.Scatter(
        x=x.astype(np.float32),
        y=y.astype(np.float32),
        mode="lines",
        name=name,
        legendgroup=name,
        line={"color": color, "width": style.pop("width", 1.2)},
        **style,
    )


def styled(figure: go.Figure, height: int) -> go.Figure:
    """The look that all figures of a report share."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 70, "r": 20, "t": 30, "b": 45},
        font={"family": "system-ui, sans-serif", "size": 12},
        legend={"orientation": "h", "y": 1.06, "x": 0},
        hovermode="x unified",
    )
    return figure


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
            line = _line(channel.time, _shown(name, values, trace.atmosphere), color, kind, showlegend=number == 0)
            figure.add_trace(line, row=row, col=1)
        label, scale = RESIDUAL[name]
        figure.add_trace(
            _line(channel.time, channel.residual * scale, MEASURED, "residual", showlegend=False, width=0.7),
            row=row + 1,
            col=1,
        )
        figure.update_yaxes(title_text=LABEL[name], row=row, col=1)
        figure.update_yaxes(title_text=label, row=row + 1, col=1)
    if trace.pwm is not None:
        duty = _line(trace.channels["pwm"].time, trace.pwm, DUTY, "duty", line_shape="hv", showlegend=False)
        figure.add_trace(duty, row=rows, col=1)
        figure.update_yaxes(title_text="duty, %", row=rows, col=1)
    figure.update_xaxes(title_text="time, s", row=rows, col=1)
    return styled(figure, round(75 * sum(heights)))


def loop_figure(result: TraceResult) -> go.Figure:
    """Position over chamber pressure: the hysteresis loop. Sensor offsets removed."""
    figure, atmosphere = go.Figure(), result.trace.atmosphere
    for name, axes in (("measured", measured_pair(result)), ("simulated", result.simulated)):
        stride = -(-len(axes["x_d"]) // (2 * POINTS))
        figure.add_trace(
            go.Scatter(
                x=_shown("p_act", axes["p_act"], atmosphere)[::stride].astype(np.float32),
                y=_shown("x_d", axes["x_d"], atmosphere)[::stride].astype(np.float32),
                mode="lines",
                name=name,
                line={"color": MEASURED if name == "measured" else SIMULATED, "width": 1.2},
            )
        )
    figure.update_xaxes(title_text=LABEL["p_act"])
    figure.update_yaxes(title_text=LABEL["x_d"])
    return styled(figure, 420).update_layout(hovermode="closest")


def measured_pair(result: TraceResult) -> dict[str, np.ndarray]:
    """Position and pressure at the same times without their sensors' offsets; simulated where one was not measured."""
    trace = result.trace.on_one_clock()
    pair = {}
    for name, simulated in result.simulated.items():
        values = trace.at(name)
        simulated = np.interp(trace.time, result.trace.time, simulated)
        pair[name] = simulated if values is None else values - result.offset.get(name, 0.0)
    return pair


def convergence_figure(progress: Progress) -> go.Figure:
    """Cost after every step."""
    cost = 2 * np.asarray(progress.history)
    figure = go.Figure(go.Scatter(x=np.arange(len(cost)), y=cost, mode="lines+markers", line={"color": SIMULATED}))
    figure.update_yaxes(type="log", title_text="chi^2 / N", exponentformat="power")
    figure.update_xaxes(title_text="step")
    return styled(figure, 300)


def autocorrelation_figure(results: list[TraceResult]) -> go.Figure:
    """Autocorrelation of the residuals of each trace: white residuals stay inside the band."""
    figure = make_subplots(rows=1, cols=2, subplot_titles=("position", "pressure"))
    for result in results:
        for column, channel in enumerate(("x_d", "p_act"), 1):
            if channel in result.channels:
                residual = result.channels[channel].residual
                lags = np.arange(1, min(51, len(residual)))
                rho = [autocorrelation(residual, int(lag)) for lag in lags]
                figure.add_trace(
                    go.Scatter(
                        x=lags,
                        y=np.asarray(rho, np.float32),
                        mode="lines",
                        name=result.trace.name,
                        legendgroup=result.trace.name,
                        showlegend=column == 1,
                    ),
                    row=1,
                    col=column,
                )
    for column in (1, 2):
        bound = 1.96 / np.sqrt(min(len(channel.time) for result in results for channel in result.channels.values()))
        figure.add_hrect(-bound, bound, fillcolor="#94a3b8", opacity=0.2, line_width=0, row=1, col=column)
        figure.update_xaxes(title_text="lag, samples", row=1, col=column)
    figure.update_yaxes(title_text="autocorrelation", row=1, col=1)
    return styled(figure, 340).update_layout(margin={"t": 70})


def autocorrelation(residual: np.ndarray, lag: int) -> float:
    """Autocorrelation of a residual at a lag in samples."""
    centred = residual - residual.mean()
    return float(centred[lag:] @ centred[:-lag] / (centred @ centred))


def correlation_figure(entries: list[str], covariance: np.ndarray) -> go.Figure:
    """How the estimates of the parameters hang together."""
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    figure = go.Figure(
        go.Heatmap(
            z=correlation.astype(np.float32),
            x=entries,
            y=entries,
            zmin=-1,
            zmax=1,
            colorscale="RdBu",
            colorbar={"title": "correlation"},
        )
    )
    figure.update_yaxes(autorange="reversed")
    return styled(figure, 260 + 18 * len(entries)).update_layout(
        hovermode="closest", margin={"l": 240, "b": 220, "t": 20}
    )
