"""Statements on the sensitivity of the diaphragm's response [4.1-4.5, section 4.3]."""

import functools
import itertools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import vgtjax
from vgtjax.sensitivity import (
    damping_ratio,
    frictionless_diaphragm,
    gradient_share,
    natural_frequency,
    squared_correlation,
    step_response,
)

from . import experiments
from .rows import Between, Found, Kind, Near, Rising, Row

PARAMETERS = {"area": "A_d", "mass": "m_d", "stiffness": "k_sm", "damping": "b_d"}
"""Those that section 4.1.2 varies, by field of the diaphragm."""
AT = 0.02
"""s after the step, at which section 4.1.2 reads the position."""
VARIED = 0.24
"""Part of its value by which we vary a parameter either way, as Table 4.2 varies F_c; Table 4.1 we can't read."""
LEVELS = 11
"""Values of each parameter between both ends."""
PRESSURE = 2e4
"""Pa applied; the position is proportional to it, so that no index depends on it."""
SETTLED = 1.0
"""s after the step; the slow exponential is e^-75 by then."""
MIDDLE = 5e-3
"""m; where the preload is weighed against the spring."""

BEFORE = 0.01
"""s that are simulated before a step."""

Along = Float[np.ndarray, " time"]
Response = Callable[[vgtjax.Diaphragm, float, Array], Array]


@functools.cache
def diaphragm() -> vgtjax.Diaphragm:
    """The printed diaphragm with `b_d + sigma_2` as its damping (erratum)."""
    return frictionless_diaphragm(vgtjax.Diaphragm(), vgtjax.LuGre())


def printed_response(part: vgtjax.Diaphragm, pressure: float, time: Array) -> Array:
    """Position in m as (4.4) prints it, with the wrong sign of the slow exponential; overdamped only."""
    frequency, ratio = natural_frequency(part), damping_ratio(part)
    root = jnp.sqrt(ratio**2 - 1)
    modes = [jnp.exp(-frequency * rate * time) / rate for rate in (ratio - root, ratio + root)]
    return pressure * part.area / part.stiffness * (1 + sum(modes) / (2 * root))


def simulated_response(pressure: float) -> tuple[Along, Along]:
    """Time in s after a step of pressure in Pa and position in m, of the mechanical model with its dry friction.

    Before the step the pressure balances the preload.
    """
    time, part = np.arange(0, 0.11, 1e-4), diaphragm()
    applied = float(part.preload / part.area) + np.where(time < BEFORE, 0.0, pressure)
    trace = vgtjax.Trace(time=time, p_act=experiments.STANDARD_ATMOSPHERE - applied, x_d=np.zeros_like(time))
    return time - BEFORE, np.asarray(vgtjax.simulate(experiments.mechanical(), trace).x_d)


def shares(response: Response, time: Float[np.ndarray, " time"]) -> Float[np.ndarray, "time 4"]:
    """Share of each of `PARAMETERS` in the variance of the position after a step, by exact derivatives.

    All vary independently, by the same small part of their values: the index (4.1) of a straight line.
    """
    part = diaphragm()
    slopes = jax.jit(jax.jacfwd(lambda part: response(part, PRESSURE, jnp.asarray(time))))(part)
    columns = np.stack([getattr(slopes, name) for name in PARAMETERS], axis=-1)
    return gradient_share(columns, np.array([getattr(part, name) for name in PARAMETERS]))


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _positions(part: vgtjax.Diaphragm, factors: Float[Array, "4"]) -> Array:
    """Position at `AT` for multiples of the parameters of `part`, a row each."""
    values = {name: factor * getattr(part, name) for name, factor in zip(PARAMETERS, factors, strict=True)}
    return step_response(vgtjax.replace_parameters(part, values), PRESSURE, AT)


def _levels() -> Float[np.ndarray, " levels"]:
    return np.linspace(1 - VARIED, 1 + VARIED, LEVELS)


@functools.cache
def alone() -> dict[str, float]:
    """`SRC` of each parameter when it alone is varied."""
    found = {}
    for index, symbol in enumerate(PARAMETERS.values()):
        factors = np.ones((LEVELS, len(PARAMETERS)))
        factors[:, index] = _levels()
        found[symbol] = src(factors[:, [index]], _positions(diaphragm(), factors))[0]
    return found


@functools.cache
def together() -> dict[str, float]:
    """`SRC` of each parameter when all are varied, every combination of their levels once."""
    factors = np.array(list(itertools.product(_levels(), repeat=len(PARAMETERS))))
    return _by_symbol(src(factors, _positions(diaphragm(), factors)))


def src(inputs: Float[np.ndarray, "samples inputs"], output: Float[np.ndarray, " samples"]) -> list[float]:
    """`SRC` (4.1) of each input with one output."""
    return [float(index) for index in squared_correlation(inputs, np.asarray(output)[:, None])[0]]


def _against(indices: dict[str, float]) -> tuple[float, float]:
    """The larger index of mass and damping, and the smaller one of area and stiffness."""
    return max(indices["m_d"], indices["b_d"]), min(indices["A_d"], indices["k_sm"])


def _by_symbol(values: Sequence[float]) -> dict[str, float]:
    return {symbol: float(value) for symbol, value in zip(PARAMETERS.values(), values, strict=True)}


def stiffness_leads_from() -> float:
    """Time in s after the step from which the stiffness matters more than the damping."""
    time = np.linspace(1e-3, 0.1, 991)
    stiffness, damping = shares(step_response, time)[:, 2:].T
    return float(time[np.argmax(stiffness > damping)])


def _unstable() -> float:
    """Largest growth rate in 1/s of (4.3) with its printed sign of the spring."""
    part = diaphragm()
    roots = np.roots([float(part.mass), float(part.damping), -float(part.stiffness)])
    return float(np.max(roots.real))


def _start() -> Found:
    """Position just at the step over the settled one as (4.4) prints it."""
    part = diaphragm()
    settled = float(part.area / part.stiffness) * PRESSURE
    printed, speed = jax.jvp(lambda t: printed_response(part, PRESSURE, t), (0.0,), (1.0,))
    ours = float(step_response(part, PRESSURE, jnp.zeros(()))) / settled
    facts = {"speed": f"{float(speed) / settled:.0f}", "corrected": f"{ours:.2g}", "zeta": f"{damping_ratio(part):.3f}"}
    return Found(float(printed) / settled, facts)


def _alone() -> Found:
    found = alone()
    return Found(tuple(found.values()), {"percent": f"{100 * VARIED:.0f}"})


def _together() -> Found:
    found = together()
    exact, printed = (_by_symbol(shares(form, np.array([AT]))[0]) for form in (step_response, printed_response))
    facts = {
        "percent": f"{100 * VARIED:.0f}",
        "all": _listed(found),
        "exact": _listed(exact),
        "printed": _listed(printed),
        "from": f"{1e3 * stiffness_leads_from():.0f}",
    }
    return Found(_against(found), facts)


def _settled() -> Found:
    part = diaphragm()
    spring = float(part.stiffness) * MIDDLE
    preload = float(part.preload)
    # x = (A_d p - F_0) / k_sm: relative changes of area, stiffness and preload, by the force that each stands for.
    forces = np.array([spring + preload, spring, preload])
    weighed = dict(zip(("A_d", "k_sm", "F_0"), forces**2 / np.sum(forces**2), strict=True))
    found = _by_symbol(shares(step_response, np.array([SETTLED]))[0])
    return Found(_against(found), {"weighed": _listed(weighed), "middle": f"{1e3 * MIDDLE:g}"})


def _listed(indices: dict[str, float]) -> str:
    return ", ".join(f"{symbol} {value:.3f}" for symbol, value in indices.items())


_row = functools.partial(Row, section="4.1.2 Actuator parameters")
_UNREAD = "Table 4.1 and Figures 4.1 and 4.2 in a form that we can read"

ROWS = (
    _row(
        id="spring-sign",
        kind=Kind.IDENTITY,
        quantity="fastest growth of a motion without friction, -m_d x'' - b_d x' + k_sm x = 0",
        where="(4.3)",
        printed="+ k_sm x_d, a stable actuator",
        unit="1/s",
        rule=Between(-1e3, 0.0),
        ours=_unstable,
        reason="With the printed sign the spring pushes away from rest, and the position grows at {ours} 1/s; (2.34) "
        "and the solution (4.4) have - k_sm x_d.",
    ),
    _row(
        id="step-start",
        kind=Kind.IDENTITY,
        quantity="position at the step over the settled position",
        where="(4.4)",
        printed="a step from rest",
        unit="",
        rule=Near(0.0, 1e-6),
        ours=_start,
        reason="The slow exponential has the wrong sign: as printed the rod begins at {ours} times where it ends, at a "
        "speed of {speed} times that way a second (damping ratio {zeta}). Corrected it begins at {corrected}.",
    ),
    _row(
        id="src-alone",
        kind=Kind.OWN_INPUTS,
        quantity="SRC at 0.02 s of A_d, m_d, k_sm, b_d, each varied alone",
        where="(4.1), Table 4.1, Figure 4.1",
        printed="a graph",
        unit="",
        rule=None,
        ours=_alone,
        reason="Varied alone by {percent} %, each has an index near one, as every nearly straight line has, whatever "
        "its slope: (4.1) ranks parameters only if all are varied at once.",
        missing=_UNREAD,
    ),
    _row(
        id="src-together",
        kind=Kind.OWN_INPUTS,
        quantity="SRC at 0.02 s with all varied: larger of m_d and b_d, smaller of A_d and k_sm",
        where="(4.1), (4.4), section 4.3",
        printed="A_d and k_sm are of great significance",
        unit="",
        rule=Rising(),
        ours=_together,
        reason="With all varied by {percent} % the corrected (4.4) gives {all} (by exact derivatives {exact}): at "
        "0.02 s area and damping lead, and k_sm passes b_d only {from} ms after the step. The printed (4.4) gives "
        "{printed}: the conclusion on k_sm fits the wrong sign. Ranges of variation are ours, equal for all.",
    ),
    _row(
        section="4.3 Conclusion",
        id="settled-leading",
        kind=Kind.IDENTITY,
        quantity="index of the settled position: larger of m_d and b_d, smaller of A_d and k_sm",
        where="section 4.3",
        printed="A_d and k_sm are of great significance",
        unit="",
        rule=Rising(),
        ours=_settled,
        reason="Settled, only A_d/k_sm is left. The preload, which (4.3) drops before (4.4), is of their size: at "
        "{middle} mm the three weigh {weighed}.",
    ),
)
