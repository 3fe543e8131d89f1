"""Steady flow through the nozzle: cost over cells, gradients, batches and tables, beside SciPy; a trace with it."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.parts import Stage, solve_table
from vgtjax.turbine import CELLS, Gas, Nozzle, steady

from ..bvp_nozzle import BoundaryValueNozzle
from ..data import lengthened, reference
from ..table import Section, seconds, times
from ..timing import interleave

ROUNDS, TABLE_ROUNDS, TRACE_ROUNDS = 5, 3, 15
VANE_ANGLE, SPEED, PRESSURE, OUTLET = float(np.radians(30.0)), 12000.0, 2e5, 1.05e5
BATCH = 16
TOLERANCE = 1e-2
"""Of SciPy's relative residuals: less adds nodes where the geometry has kinks, and hardly moves the mass flow."""
SECONDS, GAUGE = 10.0, 1.2e5
"""Length of the traces, and their turbine pressure in Pa gauge."""
COLUMNS = ("contestant", "cells", "first call", "time", "ratio", "mass flow off by")


def measure() -> Section:
    """Times one solve at several numbers of cells, its gradients, sixteen geometries at once, a whole table, and a
    trace that reads it."""
    section = Section("Steady flow through the nozzle", _ABOUT, COLUMNS, notes=list(_NOTES))
    _add_flows(section)
    _add_table(section)
    _add_traces(section)
    return section


def _add_flows(section: Section) -> None:
    """Rows of single flows, over the first of them."""
    nozzle, base = Nozzle(), f"steady, {CELLS} cells"
    solves = {cells: partial(_mass_flow, cells=cells) for cells in (56, 112, CELLS, 448)}
    jitted: dict[str, tuple[int, Callable[[], Any]]] = {
        f"steady, {cells} cells": (cells, partial(jax.jit(solve), nozzle)) for cells, solve in solves.items()
    }
    here = solves[CELLS]
    jitted[f"value and gradient by {_sizes(nozzle)} sizes, reverse mode"] = (
        CELLS,
        partial(jax.jit(jax.value_and_grad(here)), nozzle),
    )
    jitted["value and derivative with respect to one size, forward mode"] = CELLS, partial(jax.jit(_with_slope), nozzle)
    leads = jnp.linspace(6.5e-3, 7.5e-3, BATCH)
    jitted[f"{BATCH} geometries by vmap, each"] = CELLS, partial(jax.jit(jax.vmap(_of_lead)), leads)
    jitted[f"{BATCH} geometries by lax.map, each"] = CELLS, partial(jax.jit(partial(jax.lax.map, _of_lead)), leads)
    jitted[_SCIPY] = CELLS, _boundary_value_problem()
    timings, results = interleave({name: call for name, (_, call) in jitted.items()}, ROUNDS)
    finest = float(results["steady, 448 cells"])
    for name, timing in timings.items():
        share = BATCH if name.endswith("each") else 1
        off = "" if share > 1 else f"{abs(_first(results[name]) / finest - 1):.1e}"
        ratio = timing.ratio(timings[base]) / share
        section.add(
            name, str(jitted[name][0]), seconds(timing.first), seconds(timing.median / share), times(ratio), off
        )


def _add_table(section: Section) -> None:
    """The row of the table that a simulation reads.

    **Raises:** `RuntimeError` when a steady state is not found.
    """
    timings, results = interleave({"table": partial(solve_table, Stage())}, TABLE_ROUNDS)
    _, found = results["table"]
    if not np.all(found):
        raise RuntimeError(f"{int(np.sum(~found))} of {found.size} steady states were not found; look for why")
    name = f"a table of {found.size} points"
    section.add(name, str(CELLS), seconds(timings["table"].first), seconds(timings["table"].median), "", "")


def _add_traces(section: Section) -> None:
    """Rows of a trace with exhaust gas, over that by a map."""
    inputs = lengthened(reference("levels").trace, SECONDS)
    trace = vgtjax.Trace(
        inputs.time, pwm=inputs.pwm, p_res=inputs.p_res, p_trb=np.full(inputs.time.shape, GAUGE), name=inputs.name
    )
    laws: dict[str, vgtjax.AbstractVaneForce] = {"map": vgtjax.HysteresisMap(), "turbine": vgtjax.Turbine()}
    # Compiled with everything it reads as an argument, as a fit runs it.
    run = jax.jit(lambda model: vgtjax.simulate(model, trace).x_d)
    contestants = {name: partial(run, vgtjax.Actuator(vane_force=law)) for name, law in laws.items()}
    timings, _ = interleave(contestants, TRACE_ROUNDS)
    for name, timing in timings.items():
        shown = f'{SECONDS:g} s trace, vane_force = "{name}"'
        ratio = times(timing.ratio(timings["map"]))
        section.add(shown, "", seconds(timing.first), seconds(timing.median), ratio, "")


_SCIPY = f"SciPy solve_bvp, tolerance {TOLERANCE:g}"
_ABOUT = (
    f"The default nozzle with vanes at 30 deg, {PRESSURE / 1e5:g} bar absolute before it and {OUTLET / 1e5:g} bar "
    "behind, from the first guess, in double precision. Derivatives are those of mass flow."
)
_NOTES = (
    "Mass flow is compared with 448 cells. Ratios of flows are to one solve, those of traces to the map.",
    "SciPy solves the same balances as differential equations for velocity, temperature and swirl, on faces of 224 "
    "cells to begin with and from the same first guess. Where rows begin and end it needs ramps over a cell. It is for "
    "subsonic flow only, and has no derivatives.",
    "The table is that of a simulation, over total pressure and crank angle; a simulation begins when it is made.",
)


def _boundary_value_problem() -> Callable[[], Any]:
    """What one would write with SciPy."""
    nozzle = Nozzle()
    inlet = nozzle.inlet(jnp.asarray(PRESSURE), 900.0)
    problem = BoundaryValueNozzle(nozzle.passage(VANE_ANGLE, SPEED, CELLS), inlet, OUTLET, Gas())
    return partial(problem.solve, TOLERANCE)


def _mass_flow(nozzle: Nozzle, cells: int = CELLS) -> Any:
    """Flow in kg/s."""
    passage, inlet = nozzle.passage(VANE_ANGLE, SPEED, cells), nozzle.inlet(jnp.asarray(PRESSURE), 900.0)
    return steady(passage, inlet, jnp.asarray(OUTLET), Gas()).mass_flow


def _of_lead(lead: Any) -> Any:
    """Flow in kg/s of a nozzle whose leading edges are so many m before the pivots."""
    return _mass_flow(Nozzle(lead=lead))


def _with_slope(nozzle: Nozzle) -> Any:
    return jax.jvp(_of_lead, (nozzle.lead,), (jnp.ones_like(nozzle.lead),))


def _sizes(nozzle: Nozzle) -> int:
    return len(jax.tree.leaves(nozzle))


def _first(result: Any) -> float:
    return float(jax.tree.leaves(result)[0])
