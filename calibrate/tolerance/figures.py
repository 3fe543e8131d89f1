"""Pictures of a tolerance study, in the style of Figs 4.5 to 4.9: lines of the traces over the simulated band."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgtjax.experiments import POSITIONS, SHOWN, MeasuredLoops, Output, label

from ..output.figures import curve, points, styled
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
    for branch, values in branches.items():
        low, middle, high = envelope(values)
        figure.add_trace(_band((low, high), (position, position), showlegend=branch == "closing"))
        dash = "solid" if branch == "closing" else "dash"
        figure.add_trace(curve(middle, position, f"median, {branch}", LINE, width=2, dash=dash))
    units = {name: loops for name, loops in measured.items() if pressure in loops.turbine_pressures}
    for number, (name, loops) in enumerate(units.items()):
        loop = loops.loops[loops.turbine_pressures.index(pressure)]
        figure.add_trace(_unit_curve(loop.closing / 100, position, name, showlegend=number == 0))
        figure.add_trace(_unit_curve(loop.opening / 100, position, name, showlegend=False))
    return styled(figure, 440, "chamber pressure, mbar gauge", "position, mm", hovermode="closest")


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
        low, middle, high = np.column_stack([np.zeros(3), *bands])
        lines = [_band((axis, axis), (low, high)), curve(axis, middle, "median", LINE, width=2)]
        for number, line in enumerate(lines + _measured_effects(measured, pressures, names)):
            line.showlegend = column == 1 and number < 3
            figure.add_trace(line, row=1, col=column)
    figure.update_yaxes(title_text="change of chamber pressure, mbar", row=1, col=1)
    look: dict[str, Any] = {"hovermode": "closest", "margin": {"t": 70}, "legend": {"y": 1.2}}
    return styled(figure, 380, "turbine pressure, mbar gauge", **look)


def _measured_effects(measured: dict[str, MeasuredLoops], pressures: list[float], names: list[str]) -> list[go.Scatter]:
    """A line for every unit that was measured at the reference, through its points."""
    lines = []
    for unit, loops in measured.items():
        if loops.turbine_pressures[0] == pressures[0]:
            known = [(p, loops.readings[n]) for p, n in zip(pressures[1:], names, strict=True) if n in loops.readings]
            x, y = np.array([(pressures[0], 0.0), *known], float).T / 100
            lines.append(_unit_curve(x, y, unit, mode="lines+markers", marker={"size": 4}))
    return lines


def histogram(output: Output, values: np.ndarray, limit: Limit | None, measured: list[float]) -> go.Figure:
    """How often which value occurs, in the unit shown; limits in red, units with traces as ticks below."""
    defined = values[np.isfinite(values)]
    low, high = (defined.min(), defined.max()) if len(defined) else (0.0, 1.0)
    slack = 1e-9 * max(abs(low), abs(high), 1e-9)  # a saturated output differs by rounding only
    counts, edges = np.histogram(defined, BINS, (low - slack, high + slack))
    share = 100 * counts / max(len(values), 1)
    figure = go.Figure(
        go.Bar(x=(edges[1:] + edges[:-1]) / 2, y=share, width=np.diff(edges), marker={"color": LINE, "opacity": 0.55})
    )
    if measured:
        figure.add_trace(points(measured, np.zeros(len(measured)), "units", UNIT, 12, symbol="line-ns-open"))
    for end in () if limit is None else (limit.lower, limit.upper):
        if end is not None:
            figure.add_vline(end, line={"color": "#b91c1c", "width": 2})
    x = f"{output.name}, {scaled(output).unit}"
    return styled(figure, 260, x, "samples, %", showlegend=False, hovermode="closest", bargap=0)


def step_figure(output: Output, values: np.ndarray, nominal: np.ndarray) -> go.Figure:
    """Envelope of a curve over time, with the nominal actuator's."""
    shown = scaled(output)
    axis = np.array(output.axis) * shown.axis_factor
    low, _, high = envelope(values)
    figure = go.Figure([_band((axis, axis), (low, high)), curve(axis, nominal, "nominal", LINE, width=2)])
    y = f"{'pressure' if output.unit == 'Pa' else 'position'}, {shown.unit}"
    return styled(figure, 320, f"time after the step, {shown.axis_unit}", y)


def _band(x: tuple[np.ndarray, np.ndarray], y: tuple[np.ndarray, np.ndarray], **style: Any) -> go.Scatter:
    """The area between two curves, whose ends `x` and `y` hold."""
    there_and_back = [np.concatenate([first, second[::-1]]).astype(np.float32) for first, second in (x, y)]
    area = {"mode": "lines", "fill": "toself", "fillcolor": BAND, "line": {"width": 0}, "hoverinfo": "skip"}
    name = f"simulated, {ENVELOPE[0]:.0%} to {ENVELOPE[-1]:.0%}"
    return go.Scatter(x=there_and_back[0], y=there_and_back[1], name=name, legendgroup=name, **area, **style)


def _unit_curve(x: np.ndarray, y: np.ndarray, unit: str, **style: Any) -> go.Scatter:
    return curve(x, y, "units with traces", UNIT, width=0.8, hovertext=unit, **style)
