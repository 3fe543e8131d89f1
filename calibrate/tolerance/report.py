"""The report of a tolerance study: one HTML file that carries all it shows, in the style of Figs 4.5 to 4.9."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
import scipy
from plotly.subplots import make_subplots

from vgtjax.experiments import POSITIONS, SHOWN, MeasuredLoops, Output, SlowLoop, StepResponse, label
from vgtjax.population import Results

from ..output.figures import curve, points, styled
from ..output.page import render_page
from ..population import ChunkStore, PopulationJob, say_active, scaled
from .summary import ENVELOPE, envelope

BAND, LINE, UNIT = "rgba(194, 65, 12, 0.22)", "#c2410c", "#475569"
BINS = 60
SHOWN_FAILURES = 10


def render(job: PopulationJob, store: ChunkStore, known: Results, summary: dict[str, Any]) -> str:
    """The report as HTML."""
    failed = summary["failed"]["samples"][:SHOWN_FAILURES]
    pressures = next(each for each in job.experiments if isinstance(each, SlowLoop)).turbine_pressures
    directions = {"open": "Opening vanes [Fig. 4.8]", "closed": "Closing vanes [Fig. 4.9]"} if pressures[1:] else {}
    limits = job.study.tolerance.limits
    limited = [each for each in store.numbers if each.name in limits or each.name.startswith("hysteresis_")]
    steps = [each for each in job.experiments if isinstance(each, StepResponse)]
    positions = [output for step in steps for output in step.outputs if output.axis and output.unit == "m"]
    return render_page(
        "tolerance.html.jinja",
        **job.heading(),
        summary=summary,
        active=say_active(job.population, summary["active_friction"]["count"], summary["samples"]),
        failed=[(one["sample"], one["cause"].replace("_", " "), _unusual(job, one["values"])) for one in failed],
        loops=[(f"{at / 100:.0f} mbar at the turbine inlet", _loop_figure(job, store, at)) for at in pressures],
        effects=[(title, _effect_figure(job, store, direction, pressures)) for direction, title in directions.items()],
        histograms=[_histogram_figure(job, store, output) for output in limited],
        steps=[(output.meaning, _step_figure(output, store, known)) for output in positions],
        units=_units(job, summary),
    )


def _unusual(job: PopulationJob, values: dict[str, float]) -> list[tuple[str, float, float]]:
    """The quantities of a sample that lie farthest out, with their normal scores."""
    margins = zip(job.population.factors.entries, job.population.margins, strict=True)
    scores = [
        (entry, values[entry], float(scipy.special.ndtri(margin.cdf(values[entry]))))
        for entry, margin in margins
        if values[entry] is not None
    ]
    return sorted(scores, key=lambda score: -abs(score[2]))[:4]


def _units(job: PopulationJob, summary: dict[str, Any]) -> dict[str, Any] | None:
    """Measured widths beside those that the unit's own fitted model gives."""
    if not summary["units"]:
        return None
    pressures = sorted({float(at) for unit in summary["units"].values() for at in unit["hysteresis_mbar"]})
    rows = []
    for name, unit in summary["units"].items():
        simulated = summary["simulated_units"].get(name, {})
        cells = [(unit["hysteresis_mbar"].get(f"{at:g}"), simulated.get(f"hysteresis_{at:g}mbar")) for at in pressures]
        rows.append({"name": name, "cells": cells})
    return {"pressures": [f"{at:g}" for at in pressures], "rows": rows, "fitted": bool(summary["simulated_units"])}


def _loop_figure(job: PopulationJob, store: ChunkStore, pressure: float) -> go.Figure:
    """Position over chamber pressure at one turbine pressure [Figs 4.5 to 4.7]."""
    figure, position = go.Figure(), POSITIONS * 1e3
    for branch in ("closing", "opening"):
        low, middle, high = envelope(store[f"{branch}_pressure_{label(pressure)}"] / 100)
        figure.add_trace(_band((low, high), (position, position), showlegend=branch == "closing"))
        dash = "solid" if branch == "closing" else "dash"
        figure.add_trace(curve(middle, position, f"median, {branch}", LINE, width=2, dash=dash))
    units = {name: loops for name, loops in job.measured.items() if pressure in loops.turbine_pressures}
    for number, (name, loops) in enumerate(units.items()):
        loop = loops.loops[loops.turbine_pressures.index(pressure)]
        figure.add_trace(_unit_curve(loop.closing / 100, position, name, showlegend=number == 0))
        figure.add_trace(_unit_curve(loop.opening / 100, position, name, showlegend=False))
    return styled(figure, 440, "chamber pressure, mbar gauge", "position, mm", hovermode="closest")


def _effect_figure(job: PopulationJob, store: ChunkStore, direction: str, pressures: Sequence[float]) -> go.Figure:
    """Change of the `open` or `closed` vanes' pressure with turbine pressure, at three positions [Figs 4.8, 4.9].

    **Arguments:** `pressures` in Pa gauge, the first of which is the reference.
    """
    titles = [f"at {place * 1e3:g} mm" for place in SHOWN]
    figure = make_subplots(rows=1, cols=len(SHOWN), subplot_titles=titles, shared_yaxes=True)
    axis = np.array(pressures) / 100
    for column, place in enumerate(SHOWN, 1):
        names = [f"{direction}_vane_effect_{label(at)}_{place * 1e3:g}mm" for at in pressures[1:]]
        bands = [envelope(store[name][:, None] / 100) for name in names]
        low, middle, high = np.column_stack([np.zeros(3), *bands])
        lines = [_band((axis, axis), (low, high)), curve(axis, middle, "median", LINE, width=2)]
        for number, line in enumerate(lines + _measured_effects(job.measured, pressures, names)):
            line.showlegend = column == 1 and number < 3
            figure.add_trace(line, row=1, col=column)
    figure.update_yaxes(title_text="change of chamber pressure, mbar", row=1, col=1)
    look: dict[str, Any] = {"hovermode": "closest", "margin": {"t": 70}, "legend": {"y": 1.2}}
    return styled(figure, 380, "turbine pressure, mbar gauge", **look)


def _measured_effects(
    measured: dict[str, MeasuredLoops], pressures: Sequence[float], names: list[str]
) -> list[go.Scatter]:
    """A line for every unit that was measured at the reference, through its points."""
    lines = []
    for unit, loops in measured.items():
        if loops.turbine_pressures[0] == pressures[0]:
            known = [(p, loops.readings[n]) for p, n in zip(pressures[1:], names, strict=True) if n in loops.readings]
            x, y = np.array([(pressures[0], 0.0), *known], float).T / 100
            lines.append(_unit_curve(x, y, unit, mode="lines+markers", marker={"size": 4}))
    return lines


def _histogram_figure(job: PopulationJob, store: ChunkStore, output: Output) -> go.Figure:
    """How often which value occurs, in the unit shown; limits in red, units with traces as ticks below."""
    name, factor = output.name, scaled(output).factor
    values, limit = store[name] * factor, job.study.tolerance.limits.get(name)
    measured = [float(loops.readings[name]) * factor for loops in job.measured.values() if name in loops.readings]
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


def _step_figure(output: Output, store: ChunkStore, known: Results) -> go.Figure:
    """Envelope of a curve over time, with the nominal actuator's."""
    shown = scaled(output)
    axis, nominal = np.array(output.axis) * shown.axis_factor, known[output.name][0] * shown.factor
    low, _, high = envelope(store[output.name] * shown.factor)
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
