"""Figures of the reproduction report (plotly)."""

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

import vgtjax

from ..output.figures import DUTY, MEASURED, SIMULATED, curve, styled
from . import air_flow, control_experiments, experiments, loops, reduced_models, responses, vanes

SHADES = ("#0f766e", "#c2410c", "#4338ca", "#a16207")


def flow_figure() -> go.Figure:
    """Phi over the pressure ratio, printed and corrected [2.15, 2.58]."""
    figure = go.Figure()
    for name, color, (ratio, values) in zip(
        ("corrected", "(2.15) as printed", "(2.58) as printed"),
        (SIMULATED, DUTY, MEASURED),
        air_flow.curves(),
        strict=True,
    ):
        figure.add_trace(curve(ratio, values, name, color, dash="solid" if name == "corrected" else "dash"))
    figure.update_xaxes(title_text="pressure ratio, downstream over upstream")
    figure.update_yaxes(title_text="Phi")
    return styled(figure, 340)


def response_figure() -> go.Figure:
    """Steps of the duty and their release, with the printed response times."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for duty, color in zip(experiments.DUTIES, SHADES, strict=False):
        solution = experiments.duty_pulse(duty)
        gauge = (solution.p_act - experiments.STANDARD_ATMOSPHERE) / experiments.MBAR
        for row, values in enumerate((gauge, 1e3 * solution.x_d), 1):
            figure.add_trace(
                curve(np.asarray(solution.time), np.asarray(values), f"{duty:g} %", color, showlegend=row == 1),
                row=row,
                col=1,
            )
    for stated in responses.STATED:
        response = stated.response()
        if stated.signal == "pressure":
            row, shown = 1, (response.pressure - experiments.STANDARD_ATMOSPHERE) / experiments.MBAR
        else:
            row, shown = 2, 1e3 * response.position
        marker = go.Scatter(
            x=[stated.seconds + (experiments.HOLD if stated.released else 0.0)],
            y=[float(np.interp(stated.seconds, response.time, shown))],
            mode="markers",
            name="response time as printed",
            legendgroup="printed",
            showlegend=stated is responses.STATED[0],
            hovertext=f"{stated.duty:g} %: {stated.seconds:g} s",
            marker={"symbol": "triangle-up", "size": 10, "color": "black"},
        )
        figure.add_trace(marker, row=row, col=1)
    figure.update_yaxes(title_text="pressure, mbar gauge", row=1, col=1)
    figure.update_yaxes(title_text="position, mm", row=2, col=1)
    figure.update_xaxes(title_text="time, s", row=2, col=1)
    return styled(figure, 520)


def loop_figure() -> go.Figure:
    """Position over applied pressure at three turbine pressures, with a borrowed vane force."""
    figure = go.Figure()
    for (pressure, run), color in zip(loops.runs().items(), SHADES, strict=False):
        applied = (experiments.STANDARD_ATMOSPHERE - np.asarray(run.p_act)) / experiments.MBAR
        stride = 8
        figure.add_trace(
            go.Scatter(
                x=applied[::stride].astype(np.float32),
                y=(1e3 * np.asarray(run.x_d)[::stride]).astype(np.float32),
                mode="lines",
                name=f"{pressure / experiments.MBAR:g} mbar",
                line={"color": color, "width": 1.4},
            )
        )
    figure.update_xaxes(title_text="applied pressure, mbar")
    figure.update_yaxes(title_text="position, mm")
    return styled(figure, 420).update_layout(hovermode="closest")


def polynomial_figure() -> go.Figure:
    """Force over crank angle as (3.15) prints it."""
    figure = go.Figure()
    ratios = (1.0, 1.5, 2.0, 2.5)
    for ratio, color in zip(ratios, SHADES, strict=True):
        figure.add_trace(curve(vanes.ANGLES, vanes.polynomial(vanes.ANGLES, ratio), f"ratio {ratio:g}", color))
    figure.update_xaxes(title_text="crank angle, deg (closed at 4)")
    figure.update_yaxes(title_text="force against closing, N")
    return styled(figure, 340)


def validation_figure() -> go.Figure:
    """The example's actuator along two steps and a ramp: traces, and the full model with both that are made of it."""
    rows, columns = len(reduced_models.SIGNALS) + 1, len(reduced_models.TRACES)
    figure = make_subplots(rows, columns, shared_xaxes=True, vertical_spacing=0.05, horizontal_spacing=0.05)
    dashes = dict(zip(reduced_models.MODELS, ("solid", "dash", "dot"), strict=True))
    for col, name in enumerate(reduced_models.TRACES, 1):
        found = reduced_models.along(name)
        traced, time = _panels(found.measured, found.measured), found.measured.time
        for row in (1, 2):
            figure.add_trace(curve(time, traced[row - 1], "trace", MEASURED, showlegend=col == row == 1), row, col)
        for (model, run), color in zip(found.solutions.items(), SHADES, strict=False):
            for row, values in enumerate(_panels(run, found.measured), 1):
                line = curve(time, values, model, color, dash=dashes[model], showlegend=col == row == 1)
                figure.add_trace(line, row, col)
        figure.update_xaxes(title_text=f"time, s ({reduced_models.TRACES[name]})", row=rows, col=col)
    for row, title in enumerate(("pressure, mbar gauge", "position, mm", "pressure error, mbar"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_traces(line_width=4, selector={"name": "trace"})
    return styled(figure, 680)


def _panels(run: vgtjax.Solution | vgtjax.Trace, trace: vgtjax.Trace) -> tuple[np.ndarray, ...]:
    """Pressure in mbar gauge, position in mm, and how far the pressure is above that of the trace in mbar."""
    pressure = np.asarray(run.p_act)
    gauge = (pressure - trace.atmosphere) / experiments.MBAR
    return gauge, 1e3 * np.asarray(run.x_d), (pressure - np.asarray(trace.p_act)) / experiments.MBAR


def closed_loop_figure() -> go.Figure:
    """Position and error of each controller along three references, at the largest turbine pressure."""
    courses = control_experiments.FOLLOWERS
    names = list(dict.fromkeys(name for followers in courses.values() for name in followers))
    shades = dict(zip(names, (*SHADES, DUTY), strict=True))
    figure = make_subplots(2, len(courses), shared_xaxes=True, vertical_spacing=0.06, horizontal_spacing=0.06)
    for col, (course, followers) in enumerate(courses.items(), 1):
        for name in followers:
            run = control_experiments.runs(name, course)
            settled = run.time >= control_experiments.SETTLED
            for row, values in enumerate((run.position[-1], run.error[-1]), 1):
                line = curve(run.time[settled], 1e3 * values[settled], name, shades[name], showlegend=False)
                figure.add_trace(line, row, col)
        figure.update_xaxes(title_text=f"time, s ({course})", row=2, col=col)
    for name in names:
        next(figure.select_traces(selector={"name": name})).showlegend = True
    for row, title in enumerate(("position, mm", "reference less position, mm"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    return styled(figure, 560)


ALL = (
    (
        "Steps of the duty",
        "Printed parameters; triangles are the printed response times.",
        response_figure,
    ),
    ("Flow function", "The factor 2/(gamma-1) belongs under the root; only then is Phi continuous.", flow_figure),
    (
        "Loops at three turbine pressures",
        "The printed actuator with vane forces identified from loops that an independent plant simulated; the thesis "
        "shows its own as pictures.",
        loop_figure,
    ),
    (
        "Force polynomial",
        "Equation (3.15) with the printed coefficients, without a guard of its range, which is not printed.",
        polynomial_figure,
    ),
    (
        "Three models along simulated traces",
        "Full model, six and four states [5.2, 5.4] along traces of the example's actuator that the full model was not "
        "fitted to; an independent plant simulated them, with noise. The models for control leave out how air cools "
        "and warms, which is their error while it flows.",
        validation_figure,
    ),
    (
        "Closed loops at 3000 mbar",
        "The printed actuator with borrowed vane forces and noisy sensors; from two seconds on, when the figures of "
        "the table count. Friction observer and backstepping know this plant exactly.",
        closed_loop_figure,
    ),
)
"""Title, text and function of every figure."""
