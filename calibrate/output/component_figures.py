"""What the components of a model look like: each law against its input (plotly)."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import plotly.graph_objects as go

import vgtjax
from vgtjax.parts import AbstractGasTables, Contact, HasCrank, Vanes
from vgtjax.plants import AbstractRodModel, as_actuator

from .figures import MEASURED, PALETTE, curve, styled

USUAL_PRESSURES = (0.5e5, 1.0e5, 1.5e5)
"""Pa gauge before the turbine, where no trace says others."""
WAYS = {"closing": 0.1, "opening": -0.1}
"""m/s; usual speeds of the rod, at which no law lies between its sides."""
ROUNDED = 1e4
"""Pa to which pressures of traces are rounded, so that loops at nearly one pressure are one curve."""


def component_figures(model: vgtjax.AbstractModel, traces: Sequence[vgtjax.Trace]) -> list[tuple[str, go.Figure]]:
    """Title and figure of every law that the model has: magnet, areas, flow function, friction, vane force; the last at
    the mean turbine pressures of traces."""
    full = as_actuator(model)
    figures = _air_path_figures(full) if full else []
    if not isinstance(model, AbstractRodModel):
        return figures
    figures.append(("Friction against velocity [3.7]", friction_figure(model)))
    if model.vane_force.feels_gas:
        figures.append((_vane_force_title(model.vane_force), vane_force_figure(model, _turbine_pressures(traces))))
    return figures


def _vane_force_title(vane_force: vgtjax.AbstractVaneForce) -> str:
    source = f" [{vane_force.equations}]" if vane_force.equations else ""
    caveat = f", {vane_force.caveat}" if vane_force.caveat else ""
    return f"Exhaust gas force on the rod{source}{caveat}"


def _air_path_figures(model: vgtjax.Actuator) -> list[tuple[str, go.Figure]]:
    """Pull on a closed plunger; area of the orifice to the reservoir (below zero) or the atmosphere (above); Phi."""
    duty, position, ratio = np.linspace(0.0, 100.0, 201), np.linspace(-3e-3, 1e-3, 801), np.linspace(0.0, 1.0, 501)
    pull, area, flow, critical = map(np.asarray, _air_path_laws(model, duty, position, ratio))
    phi = _plot([(ratio, flow, "")], "pressure ratio", "Phi")
    phi.add_vline(float(critical), line_dash="dot", line_color=MEASURED)
    areas = _plot([(position * 1e3, area * 1e6, "")], "plunger position, mm", "effective area, mm²")
    return [
        ("Magnetic force against duty [2.9]", _plot([(duty, pull, "")], "duty, %", "magnetic force, N")),
        ("Effective areas against plunger position [B.2, B.3]", areas),
        ("Flow function [2.15]", phi),
    ]


@eqx.filter_jit
def _air_path_laws(model: vgtjax.Actuator, duty: Any, position: Any, ratio: Any) -> tuple[Any, Any, Any, Any]:
    """Magnetic force, effective area, flow function and critical ratio: one program instead of thirty small ones."""
    pull = model.converter.magnetic_force.steady_pull(duty, jnp.zeros_like(duty))
    area = jax.vmap(model.converter.orifice_area)(position)
    return pull, area, vgtjax.flow_function(model.air, ratio), model.air.critical_ratio()


def friction_figure(model: AbstractRodModel) -> go.Figure:
    """Steady force of friction over the velocity, without exhaust gas."""
    speed = np.geomspace(1e-5, 6e-3, 60)
    velocity = np.concatenate([-speed[::-1], speed])
    cold = Vanes(np.full_like(velocity, 5e-3), np.zeros_like(velocity))
    contacts = Contact(velocity, np.full_like(velocity, model.diaphragm.mass), cold)
    force = jax.jit(jax.vmap(model.friction.steady_force))(contacts)
    return _plot([(velocity * 1e3, force, "")], "velocity, mm/s", "friction, N")


def _turbine_pressures(traces: Sequence[vgtjax.Trace]) -> Sequence[float]:
    seen = [trace.at("p_trb") for trace in traces]
    means = {ROUNDED * round(float(np.mean(each)) / ROUNDED) for each in seen if each is not None}
    return sorted(mean for mean in means if mean > 0)[: len(PALETTE)] or USUAL_PRESSURES


def vane_force_figure(model: AbstractRodModel, turbine_pressures: Sequence[float] = USUAL_PRESSURES) -> go.Figure:
    """Force over the crank angle, or over the opening where there is no crank, at several turbine pressures in Pa
    gauge, those of its knots where it has any; closing and opening, where that makes a difference."""
    vane_force = model.vane_force
    travel = float(model.diaphragm.travel)
    opening = np.linspace(0.0, travel, 201)
    pressures = vane_force.turbine_pressure if isinstance(vane_force, AbstractGasTables) else turbine_pressures
    along, label = opening * 1e3, "opening, mm"
    if isinstance(vane_force, HasCrank):
        along, label = np.asarray(vane_force.crank.angle(opening)), "crank angle, deg"
    curves = []
    steady = jax.vmap(vane_force.steady_force)
    for pressure in np.asarray(pressures):
        vanes = Vanes(opening, np.full_like(opening, pressure))
        ways = {name: steady(vanes, np.full_like(opening, speed)) for name, speed in WAYS.items()}
        if np.array_equal(*ways.values()):
            ways = {"": ways["closing"]}
        curves += [(along, force, f"{pressure / 100:.0f} mbar {name}".strip()) for name, force in ways.items()]
    return _plot(curves, label, "force against closing, N")


def _plot(curves: list[tuple[Any, Any, str]], x_label: str, y_label: str) -> go.Figure:
    figure = go.Figure()
    for number, (x, y, name) in enumerate(curves):
        color = PALETTE[number % len(PALETTE)]
        figure.add_trace(curve(x, y, name, color, width=1.6, showlegend=bool(name)))
    return styled(figure, 340, x_label, y_label)
