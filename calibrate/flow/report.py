"""The report of a nozzle: one HTML file that carries all it shows."""

import hashlib
from typing import Any

import equinox as eqx
import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

import vgtjax
from vgtjax.turbine import VANES, WHEEL

from ..output.figures import PALETTE, curve, styled
from ..output.page import render_page
from .nozzle_map import QUANTITIES, NozzleMap
from .passages import Along
from .pulse import Pulse

PLAIN = "#334155"
TITLES = {
    "mass_flow": ("mass flow, g/s", 1e3),
    "power": ("shaft power, kW", 1e-3),
    "vane_moment": ("moment on a vane, N mm", 1e3),
    "rod_force": ("force at the rod, N", 1.0),
}


def render(
    turbine: vgtjax.Turbine,
    found: NozzleMap,
    along: list[Along],
    pulse: Pulse | None,
    summary: dict[str, Any],
    text: str,
) -> str:
    """The report as HTML."""
    return render_page(
        "flow.html.jinja",
        title="Flow through the nozzle",
        summary=summary,
        text=text,
        fingerprint=hashlib.sha256(text.encode()).hexdigest(),
        quantities={name: (QUANTITIES[name], row) for name, row in summary["quantities"].items()},
        parameters=_parameters(turbine, pulse),
        pressure=along[0].total_pressure,
        source=None if pulse is None else pulse.source,
        overloaded=[each for each in along if each.largest_load > each.total_pressure],
        sections=[
            ("The map", map_figure(found)),
            ("The flow along the passage", along_figure(along)),
            ("A vane and its load", vane_figure(along)),
            *([] if pulse is None else [("Pulsation", pulse_figure(pulse))]),
        ],
    )


def map_figure(found: NozzleMap) -> go.Figure:
    """Contours of what the map says over pressure ratio and crank angle."""
    titles = [title for title, _ in TITLES.values()]
    # Axes are named at the margins only: on a narrow screen names between pictures lie over their neighbours.
    figure = make_subplots(
        2, 2, subplot_titles=titles, vertical_spacing=0.1, shared_xaxes=True, shared_yaxes=True, horizontal_spacing=0.05
    )
    for number, (name, (_, scale)) in enumerate(TITLES.items()):
        row, column = divmod(number, 2)
        contours = go.Contour(
            x=found.pressure_ratio,
            y=found.crank_angle,
            z=(found.values[name] * scale).T,
            colorscale="Oranges",
            contours={"showlabels": True, "labelfont": {"size": 10}},
            ncontours=14,
            line={"width": 0.7},
            showscale=False,
        )
        figure.add_trace(contours, row=row + 1, col=column + 1)
    figure.update_xaxes(title_text="pressure ratio", row=2)
    figure.update_yaxes(title_text="crank angle, deg", col=1)
    return styled(figure, 760, hovermode="closest", margin={"t": 80})


def along_figure(along: list[Along]) -> go.Figure:
    """Mach number, pressure and swirl along the passage, the rows of blades shaded."""
    figure = make_subplots(3, 1, shared_xaxes=True, vertical_spacing=0.05)
    for each, color in zip(along, PALETTE, strict=False):
        m, name = np.asarray(each.flow.m) * 1e3, f"crank at {each.crank_angle:g} deg"
        for row, values in enumerate((each.mach_number, np.asarray(each.flow.pressure) / 1e5, each.swirl), 1):
            figure.add_trace(curve(m, values, name, color, width=1.7, showlegend=row == 1), row=row, col=1)
    shown = along[1]
    for number, label in ((VANES, "vanes"), (WHEEL, "wheel")):
        m = np.asarray(shown.passage.m)[:-1][shown.row == number] * 1e3
        shade = {"fillcolor": "#94a3b8", "opacity": 0.15, "line_width": 0, "col": 1}
        for row in (1, 2, 3):
            # Named at the top only, where no curve runs through it.
            named = {"annotation_text": label} if row == 1 else {}
            figure.add_vrect(m[0], m[-1], row=row, **shade, **named)
    for row, title in enumerate(("Mach number", "pressure, bar abs", "swirl r V<sub>u</sub>, m²/s"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text=f"m, mm (shaded: rows at {shown.crank_angle:g} deg)", row=3, col=1)
    return styled(figure, 720)


def vane_figure(along: list[Along]) -> go.Figure:
    """Where the vanes stand, and the pressure difference over one of them along its chord."""
    figure = make_subplots(1, 2, subplot_titles=("vanes, mm", "load, mbar"))
    for each, color in zip(along, PALETTE, strict=False):
        name = f"crank at {each.crank_angle:g} deg"
        for x, y in _vanes(each):
            figure.add_trace(curve(x, y, name, color, width=2.5, showlegend=False), row=1, col=1)
        load = curve(each.chord * 1e3, each.load / 100, name, color, width=1.7)
        figure.add_trace(load, row=1, col=2)
    nozzle = along[0].stage.nozzle
    pivots = float(nozzle.pivot_radius) * 1e3 * np.exp(1j * nozzle.pitch * np.arange(-1, 2))
    dots = go.Scatter(x=pivots.imag, y=pivots.real, mode="markers", marker={"color": PLAIN}, showlegend=False)
    figure.add_trace(dots, row=1, col=1)
    figure.add_vline(0.0, line_dash="dot", line_color=PLAIN, row=1, col=2)
    figure.update_yaxes(scaleanchor="x", row=1, col=1)
    figure.update_xaxes(title_text="mm", row=1, col=1)
    figure.update_xaxes(title_text="place on the chord from the pivot, mm (volute on the left)", row=1, col=2)
    return styled(figure, 460, hovermode="closest", margin={"t": 80}, legend={"y": 1.2})


def _vanes(each: Along) -> list[tuple[Any, Any]]:
    """Ends of three neighbouring vanes in mm, the axis of the turbine in the origin."""
    nozzle = each.stage.nozzle
    angle = float(each.stage.vane_angle(each.crank_angle))
    # From the pivot on top: the leading edge outwards, the trailing edge inwards.
    along = np.exp(1j * (np.pi / 2 - angle))
    ends = float(nozzle.pivot_radius) + along * np.array([float(nozzle.lead), -float(nozzle.trail)])
    turned = [1e3 * ends * np.exp(1j * nozzle.pitch * place) for place in (-1, 0, 1)]
    return [(vane.imag, vane.real) for vane in turned]


def pulse_figure(pulse: Pulse) -> go.Figure:
    """Pressure, force and position over a cycle of the engine."""
    figure = make_subplots(3, 1, shared_xaxes=True, vertical_spacing=0.05)
    # Of one colour that the legend does not have: its names are of positions.
    figure.add_trace(curve(pulse.crank, pulse.pressure / 1e5, "pressure", PLAIN, showlegend=False), row=1, col=1)
    figure.add_trace(curve(pulse.crank, pulse.force, "force", PLAIN, showlegend=False), row=2, col=1)
    for (name, position), color in zip(pulse.position.items(), PALETTE, strict=False):
        moved = (position - np.mean(position)) * 1e6
        figure.add_trace(curve(pulse.crank, moved, name, color), row=3, col=1)
    titles = "pressure, bar abs", "force at the rod, N", "position, um"
    for row, title in enumerate(titles, 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(range=[0, 720], tickvals=np.arange(0, 721, 90))
    figure.update_xaxes(title_text="crank angle of the engine, deg", row=3, col=1)
    return styled(figure, 640)


def _parameters(turbine: vgtjax.Turbine, pulse: Pulse | None) -> list[tuple[str, float, Any, Any]]:
    """Names, values, units and sources of turbine and engine; none of a nozzle was measured."""
    parts: dict[str, eqx.Module] = {"": turbine} if pulse is None else {"": turbine, "engine.": pulse.engine}
    rows = [
        (f"{prefix}{name}", float(np.asarray(vgtjax.get_parameter(part, name))), row.unit, row.source)
        for prefix, part in parts.items()
        for name, row in vgtjax.parameter_table(part).items()
    ]
    numbers = {"nozzle.vanes": turbine.nozzle.vanes, "nozzle.rotor.blades": turbine.nozzle.rotor.blades}
    rows += [(name, float(number), "1", "assumed") for name, number in numbers.items()]
    if pulse is None:
        return rows
    point = pulse.point
    stated = {
        "engine_speed": (point.engine_speed, "rpm", pulse.source),
        "trapped_mass": (point.trapped_mass, "kg", pulse.source),
        "opening_temperature": (point.opening_temperature, "K", pulse.source),
        "effective_area": (pulse.effective_area, "m2", pulse.source),
        "crank_angle": (np.asarray(point.crank_angle), "deg", "takes what effective_area takes"),
    }
    return [*rows, *((f"pulsation.{name}", float(each), unit, said) for name, (each, unit, said) in stated.items())]
