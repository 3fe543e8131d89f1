"""Pictures of a tolerance study, in the style of Figs 4.5 to 4.9: measured lines over the simulated band."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.experiments import POSITIONS, SHOWN, MeasuredLoops, Output, label

from ..output.figures import styled
from ..population import scaled
from ..study.tables import Limit
from .summary import ENVELOPE, envelope

BAND, LINE, UNIT = "rgba(194, 65, 12, 0.22)", "#c2410c", "#475569"
BINS = 60


def loop_figure(pressure: float, branches: dict[str, np.ndarray], measured: dict[str, MeasuredLoops]) -> go.Figure:
    """Position over chamber pressure at one turbine pressure [Figs 4.5 to 4.7].

    **Arguments:** `branches`: `closing` and `opening` gauge pressure in mbar of samples, `(samples, positions)`.
    """
    figure, position = go.Figure(), POSITIONS * 1e3
    for number, (branch, values) in enumerate(branches.items()):
        low, middle, high = envelope(values)
        figure.add_trace(
            go.Scatter(
                x=np.concatenate([low, high[::-1]]).astype(np.float32),
                y=np.concatenate([position, position[::-1]]).astype(np.float32),
                fill="toself",
                fillcolor=BAND,
                line={"width": 0},
                hoverinfo="skip",
                name=f"simulated, {ENVELOPE[0]:.0%} to {ENVELOPE[-1]:.0%}",
                legendgroup="band",
                showlegend=number == 0,
            )
        )
        line = {"color": LINE, "width": 2, "dash": "solid" if branch == "closing" else "dash"}
        figure.add_trace(
            go.Scatter(x=middle.astype(np.float32), y=position, mode="lines", line=line, name=f"median, {branch}")
        )
    shown = True
    for name, loops in measured.items():
        if pressure in loops.turbine_pressures:
            loop = loops.loops[loops.turbine_pressures.index(pressure)]
            for way in (loop.closing, loop.opening):
                figure.add_trace(
                    go.Scatter(
                        x=(way / 100).astype(np.float32),
                        y=position,
                        mode="lines",
                        line={"color": UNIT, "width": 0.8},
                        name="measured units",
                        legendgroup="measured",
                        showlegend=shown,
                        hovertext=name,
                    )
                )
                shown = False
    figure.update_xaxes(title_text="chamber pressure, mbar gauge")
    figure.update_yaxes(title_text="position, mm")
    return styled(figure, 440).update_layout(hovermode="closest")


def effect_figure(
    direction: str, simulated: dict[str, np.ndarray], pressures: list[float], measured: dict[str, MeasuredLoops]
) -> go.Figure:
    """Change of the opening or closing pressure with turbine pressure, at three positions [Figs 4.8, 4.9].

    **Arguments:** `direction`: `open` or `closed`; `simulated`: samples in mbar by output name; `pressures` in Pa
    gauge, the first of which is the reference.
    """
    titles = [f"at {place * 1e3:g} mm" for place in SHOWN]
    figure = make_subplots(rows=1, cols=len(SHOWN), subplot_titles=titles, shared_yaxes=True)
    axis = np.array(pressures) / 100
    for column, place in enumerate(SHOWN, 1):
        names = [f"{direction}_vane_effect_{label(at)}_{place * 1e3:g}mm" for at in pressures[1:]]
        bands = [envelope(simulated[name][:, None]) for name in names]
        lines = _measured_effects(measured, pressures, names)
        shown = [*_effect_band(axis, np.column_stack([np.zeros(3), *bands])), *lines]
        for number, line in enumerate(shown):
            line.showlegend = column == 1 and number < 3
            figure.add_trace(line, row=1, col=column)
        figure.update_xaxes(title_text="turbine pressure, mbar gauge", row=1, col=column)
    figure.update_yaxes(title_text="change of chamber pressure, mbar", row=1, col=1)
    return styled(figure, 380).update_layout(hovermode="closest", margin={"t": 70}, legend={"y": 1.2})


def _effect_band(axis: np.ndarray, quantiles: np.ndarray) -> list[go.Scatter]:
    low, middle, high = quantiles
    band = go.Scatter(
        x=np.concatenate([axis, axis[::-1]]),
        y=np.concatenate([low, high[::-1]]),
        mode="lines",
        fill="toself",
        fillcolor=BAND,
        line={"width": 0},
        hoverinfo="skip",
        name=f"simulated, {ENVELOPE[0]:.0%} to {ENVELOPE[-1]:.0%}",
    )
    return [band, go.Scatter(x=axis, y=middle, mode="lines", line={"color": LINE, "width": 2}, name="median")]


def _measured_effects(measured: dict[str, MeasuredLoops], pressures: list[float], names: list[str]) -> list[go.Scatter]:
    """A line for every unit that was measured at the reference, through its points."""
    lines = []
    for unit, loops in measured.items():
        if loops.turbine_pressures[0] != pressures[0]:
            continue
        known = [
            (at, float(loops.readings[name]))
            for at, name in zip(pressures[1:], names, strict=True)
            if name in loops.readings
        ]
        lines.append(
            go.Scatter(
                x=[pressures[0] / 100, *[at / 100 for at, _ in known]],
                y=[0.0, *[effect / 100 for _, effect in known]],
                mode="lines+markers",
                line={"color": UNIT, "width": 0.7},
                marker={"size": 4},
                name="measured units",
                legendgroup="measured",
                hovertext=unit,
            )
        )
    return lines


def histogram(output: Output, values: np.ndarray, limit: Limit | None, measured: list[float]) -> go.Figure:
    """How often which value occurs, in the unit shown; limits in red, measured units as ticks below."""
    defined = values[np.isfinite(values)]
    low, high = (defined.min(), defined.max()) if len(defined) else (0.0, 1.0)
    slack = 1e-9 * max(abs(low), abs(high), 1e-9)  # a saturated output differs by rounding only
    counts, edges = np.histogram(defined, BINS, (low - slack, high + slack))
    share = 100 * counts / max(len(values), 1)
    figure = go.Figure(
        go.Bar(x=(edges[1:] + edges[:-1]) / 2, y=share, width=np.diff(edges), marker={"color": LINE, "opacity": 0.55})
    )
    if measured:
        ticks = {"symbol": "line-ns-open", "size": 12, "color": UNIT}
        figure.add_trace(go.Scatter(x=measured, y=[0.0] * len(measured), mode="markers", marker=ticks, name="measured"))
    for end in () if limit is None else (limit.lower, limit.upper):
        if end is not None:
            figure.add_vline(end, line={"color": "#b91c1c", "width": 2})
    figure.update_xaxes(title_text=f"{output.name}, {scaled(output).unit}")
    figure.update_yaxes(title_text="samples, %")
    return styled(figure, 260).update_layout(showlegend=False, hovermode="closest", bargap=0)


def step_figure(output: Output, values: np.ndarray, nominal: np.ndarray) -> go.Figure:
    """Envelope of a curve over time, with the nominal actuator's."""
    shown = scaled(output)
    axis = np.array(output.axis) * shown.axis_factor
    low, _, high = envelope(values)
    figure = go.Figure(
        [
            go.Scatter(x=axis, y=high, line={"width": 0}, showlegend=False, hoverinfo="skip"),
            go.Scatter(
                x=axis,
                y=low,
                fill="tonexty",
                fillcolor=BAND,
                line={"width": 0},
                name=f"samples, {ENVELOPE[0]:.0%} to {ENVELOPE[-1]:.0%}",
            ),
            go.Scatter(x=axis, y=nominal, line={"color": LINE, "width": 2}, name="nominal"),
        ]
    )
    figure.update_xaxes(title_text=f"time after the step, {shown.axis_unit}")
    figure.update_yaxes(title_text=f"{'pressure' if output.unit == 'Pa' else 'position'}, {shown.unit}")
    return styled(figure, 320)
