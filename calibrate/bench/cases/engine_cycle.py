"""The periodic cycle of an engine: its root beside firings that SciPy runs out, and a batch of points."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from vgtjax.exhaust import Engine, OperatingPoint, pulsation, steady_cycle
from vgtjax.simulation import RESULTS

from ..scipy_engine import METHOD, TOLERANCE, PlainEngine
from ..table import Section, seconds
from ..timing import interleave, once

ROUNDS = 5
POINTS = {
    "1000 rpm": OperatingPoint.assumed(),
    "2000 rpm": OperatingPoint(2000.0, 0.571e-3, 1000.0, 1.05e5, 185e-6),
}
"""Assumed: an engine under load, and one at half of it."""
BATCH = 64
"""Points in even steps from the one to the other."""
ORDERS = 3
COLUMNS = ("contestant", "engine", "mean, bar", "orders, mbar", "off by", "first call", "time")


def measure() -> Section:
    """Finds cycles in both ways, and many at once."""
    section = Section("The periodic cycle of an engine", _ABOUT, COLUMNS, notes=list(_NOTES))
    for name, point in POINTS.items():
        _add_point(section, name, point)
    _add_batch(section)
    return section


def _add_point(section: Section, name: str, point: OperatingPoint) -> None:
    """Rows of one engine speed."""
    engine = Engine()
    timings, found = interleave({"root": lambda: pulsation(engine, point).p_trb}, ROUNDS)
    root, timing = np.asarray(found["root"]), timings["root"]
    section.add("root", name, *_said(root, root), seconds(timing.first), seconds(timing.median))
    took, (interval, count) = once(PlainEngine(engine, point).run_out)
    plain = np.tile(interval, engine.cylinders)
    section.add(f"SciPy {METHOD}, {count} firings run out", name, *_said(plain, root), "", seconds(took))


def _said(cycle: Float[np.ndarray, " crank"], root: Float[np.ndarray, " crank"]) -> tuple[str, str, str]:
    """Its mean, its first orders of the firing frequency, and the farthest from the root."""
    firings = len(Engine().firing_order)
    swings = 2 * np.abs(np.fft.rfft(cycle)) / len(cycle)
    orders = swings[firings * np.arange(1, ORDERS + 1)]
    off = np.max(np.abs(cycle / root - 1))
    return f"{np.mean(cycle) / 1e5:.4f}", " ".join(f"{each / 100:.1f}" for each in orders), f"{off:.1e}"


def _add_batch(section: Section) -> None:
    """The row of many operating points at once.

    **Raises:** `RuntimeError` when one of them has no periodic cycle.
    """
    engine, first, last = Engine(), *POINTS.values()
    share = jnp.linspace(0.0, 1.0, BATCH)
    points = jax.tree.map(lambda one, other: one + (other - one) * share, first, last)
    solve = jax.jit(jax.vmap(partial(steady_cycle, engine)))
    timings, results = interleave({"batch": lambda: solve(points)}, ROUNDS)
    _, ends = results["batch"]
    if not bool(jnp.all(ends == RESULTS.successful)):
        raise RuntimeError("an operating point of the batch has no periodic cycle; look for why")
    timing = timings["batch"]
    section.add(f"{BATCH} roots by vmap", "between both", "", "", "", seconds(timing.first), seconds(timing.median))


_ABOUT = (
    "The default engine at two assumed operating points, an orifice in the place of its turbine: pressure at the "
    f"turbine's inlet, its mean and its amplitudes at the first {ORDERS} multiples of the firing frequency."
)
_NOTES = (
    "Off by: the largest relative distance from the root's pressure over the cycle.",
    f"SciPy solves the same balances, written anew, at a relative tolerance of {TOLERANCE:g}, until a firing interval "
    "repeats the one before.",
)
