"""What a user would write next: SciPy's LSODA on the numba right side, restarted where the duty jumps."""

import itertools

import numpy as np
import scipy.integrate
from numba.np.unsafe.ndarray import to_fixed_tuple

import vgtjax

from .data import inputs
from .numba_plant import COUNT, at_rest, compiled, constants, pull, rates

_TYPICAL = np.array([1e-3, 0.1, 1e-2, 0.1, 1e-4, 3e2, 1e5])
"""Usual sizes of `(x_p, v_p, x_d, v_d, z, T_act, p_act)`, which scale the absolute tolerance."""


@compiled
def _field(elapsed, y, magnetic, first, interval, reservoir, row):
    """Right side `elapsed` seconds after sample `first` of an evenly sampled trace."""
    i = min(first + int(elapsed / interval), len(reservoir) - 2)
    share = elapsed / interval - (i - first)
    here = reservoir[i] + share * (reservoir[i + 1] - reservoir[i])
    state = (y[0], y[1], y[2], y[3], y[4], y[5], y[6])
    return np.array(rates(state, magnetic, here, to_fixed_tuple(row, COUNT)))


@compiled
def _begin(row, pwm, reservoir):
    return np.array(at_rest(to_fixed_tuple(row, COUNT), pwm, reservoir))


def begin(theta: np.ndarray, trace: vgtjax.Trace) -> np.ndarray:
    """State `(x_p, v_p, x_d, v_d, z, T_act, p_act)` at the first sample of a trace that begins at rest."""
    pwm, p_res = inputs(trace)
    return _begin(constants(theta), pwm[0], p_res[0])


def stretches(trace: vgtjax.Trace) -> list[tuple[int, int]]:
    """First and last sample of every stretch of constant duty; each begins where the one before it ends."""
    jumps = np.flatnonzero(np.diff(inputs(trace)[0][:-1])) + 1
    edges = [0, *jumps.tolist(), len(trace.time) - 1]
    return list(itertools.pairwise(edges))


def simulate(theta: np.ndarray, trace: vgtjax.Trace, *, rtol: float = 1e-6) -> tuple[np.ndarray, np.ndarray, int]:
    """Position and pressure at the samples of an evenly sampled trace that begins at rest, and right sides taken."""
    pwm, p_res = inputs(trace)
    row = constants(theta)
    interval = trace.longest_interval
    y = begin(theta, trace)
    states, evaluations = np.empty((len(trace.time), 7)), 0
    for first, last in stretches(trace):
        elapsed = trace.time[first : last + 1] - trace.time[first]
        found = scipy.integrate.solve_ivp(
            _field,
            (0.0, elapsed[-1]),
            y,
            method="LSODA",
            t_eval=elapsed,
            args=(pull(row, pwm[first]), first, interval, p_res, row),
            rtol=rtol,
            atol=rtol * 1e-2 * _TYPICAL,
        )
        if not found.success:
            raise RuntimeError(f"LSODA stopped on {trace.name}: {found.message}")
        states[first : last + 1] = found.y.T
        y, evaluations = found.y[:, -1], evaluations + found.nfev
    return states[:, 2], states[:, 6], evaluations
