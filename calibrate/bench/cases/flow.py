"""Steady flow through the nozzle: cost over cells, gradients and batches, beside SciPy."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from vgtjax.turbine import Gas, Nozzle, steady

from ..bvp_nozzle import BoundaryValueNozzle
from ..table import Section, seconds, times
from ..timing import interleave

ROUNDS = 5
CELLS = 224
VANE_ANGLE, SPEED, PRESSURE, OUTLET = float(np.radians(30.0)), 12000.0, 2e5, 1.05e5
BATCH = 16
TOLERANCE = 1e-2
"""Of SciPy's relative residuals: less adds nodes where the geometry has kinks, and hardly moves the mass flow."""
COLUMNS = ("contestant", "cells", "first call", "time", "ratio", "mass flow off by")


def measure() -> Section:
    """Times one solve at several numbers of cells, its gradients, and sixteen geometries at once."""
    leads = jnp.linspace(6.5e-3, 7.5e-3, BATCH)
    lead, base = jnp.asarray(7e-3), f"steady, {CELLS} cells"
    solves = {cells: partial(_mass_flow, cells=cells) for cells in (56, 112, CELLS, 448)}
    jitted: dict[str, tuple[int, Callable[[], Any]]] = {
        f"steady, {cells} cells": (cells, partial(jax.jit(solve), lead)) for cells, solve in solves.items()
    }
    here = solves[CELLS]
    jitted["value and gradient, reverse mode"] = CELLS, partial(jax.jit(jax.value_and_grad(here)), lead)
    jitted["value and derivative, forward mode"] = CELLS, partial(jax.jit(_with_slope), lead)
    jitted[f"{BATCH} geometries by vmap, each"] = CELLS, partial(jax.jit(jax.vmap(here)), leads)
    jitted[f"{BATCH} geometries by lax.map, each"] = CELLS, partial(jax.jit(lambda x: jax.lax.map(here, x)), leads)
    jitted[_SCIPY] = CELLS, _boundary_value_problem()
    timings, results = interleave({name: call for name, (_, call) in jitted.items()}, ROUNDS)
    finest = float(results["steady, 448 cells"])
    section = Section("Steady flow through the nozzle", _ABOUT, COLUMNS, notes=list(_NOTES))
    for name, timing in timings.items():
        share = BATCH if name.endswith("each") else 1
        off = "" if share > 1 else f"{abs(_first(results[name]) / finest - 1):.1e}"
        ratio = timing.ratio(timings[base]) / share
        section.add(
            name, str(jitted[name][0]), seconds(timing.first), seconds(timing.median / share), times(ratio), off
        )
    return section


_SCIPY = f"SciPy solve_bvp, tolerance {TOLERANCE:g}"
_ABOUT = (
    f"The default nozzle with vanes at 30 deg, {PRESSURE / 1e5:g} bar absolute before it and {OUTLET / 1e5:g} bar "
    "behind, from the first guess, in double precision. Gradients are those of mass flow with respect to where the "
    "vanes' pivot is."
)
_NOTES = (
    "Mass flow is compared with 448 cells.",
    "SciPy solves the same balances as differential equations for velocity, temperature and swirl, on faces of 224 "
    "cells to begin with and from the same first guess. Where rows begin and end it needs ramps over a cell. It is for "
    "subsonic flow only, and has no derivatives.",
)


def _boundary_value_problem() -> Callable[[], Any]:
    """What one would write with SciPy."""
    nozzle = Nozzle()
    inlet = nozzle.inlet(jnp.asarray(PRESSURE), 900.0)
    problem = BoundaryValueNozzle(nozzle.passage(VANE_ANGLE, SPEED, CELLS), inlet, OUTLET, Gas())
    return partial(problem.solve, TOLERANCE)


def _mass_flow(lead: Any, cells: int) -> Any:
    """Flow in kg/s of a nozzle whose leading edges are so many m before the pivots."""
    nozzle = Nozzle(lead=lead)
    return steady(
        nozzle.passage(VANE_ANGLE, SPEED, cells), nozzle.inlet(jnp.asarray(PRESSURE), 900.0), jnp.asarray(OUTLET), Gas()
    ).mass_flow


def _with_slope(lead: Any) -> Any:
    return jax.jvp(partial(_mass_flow, cells=CELLS), (lead,), (jnp.ones_like(lead),))


def _first(result: Any) -> float:
    return float(jax.tree.leaves(result)[0])
