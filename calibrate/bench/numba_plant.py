"""What a user would write first: the plant as a numba loop, RK4 with fixed steps and hard switching.

State and constants are tuples of scalars, which numba keeps in registers; divisions by parameters are done once a
run, only the orifice that is open is evaluated, and a power is one logarithm and one exponential. The equations are
the printed, corrected ones: the orifice area jumps at zero lift, and nothing is smoothed.
"""

import math

import numpy as np
from numba import njit, prange
from numba.np.unsafe.ndarray import to_fixed_tuple

import vgtjax

from .data import inputs

ENTRIES = (
    *(f"converter.{name}" for name in ("plunger_mass", "membrane_stiffness", "return_spring_stiffness")),
    *(f"converter.{name}" for name in ("plunger_damping", "actuator_area", "atmosphere_area", "reservoir_area")),
    *(f"converter.magnetic_force[{power}]" for power in range(5)),
    *(f"converter.reservoir_orifice_{name}" for name in ("slope", "saturation")),
    *(f"converter.atmosphere_orifice[{power}]" for power in range(3)),
    "chamber.volume",
    *(f"diaphragm.{name}" for name in ("mass", "area", "preload", "stiffness", "damping", "travel")),
    *(f"diaphragm.{name}" for name in ("stop_stiffness", "stop_damping")),
    *(f"friction.{name}" for name in ("static_force", "coulomb_force", "bristle_stiffness", "bristle_damping")),
    *(f"friction.{name}" for name in ("viscous_damping", "stribeck_velocity")),
    *(f"air.{name}" for name in ("gas_constant", "heat_capacity_ratio", "pressure", "temperature")),
)
"""The parameters of the plant, in the order in which it takes them."""
compiled = njit(error_model="numpy")  # no checks for division by zero: a seventh of the time
COUNT = 40
"""Constants of the right side; numba unrolls the tuple of them, so it must be a literal."""


def pack(model: vgtjax.AbstractModel) -> np.ndarray:
    """The parameters of a model as the plant takes them."""
    return np.asarray(vgtjax.Selection(ENTRIES).pack(model), dtype=np.float64)


def constants(theta: np.ndarray) -> np.ndarray:
    """What the right side needs of parameters `(..., parameters)`: reciprocals, and the critical flow."""
    v = dict(zip(ENTRIES, np.moveaxis(theta, -1, 0), strict=True))
    gamma, pressure = v["air.heat_capacity_ratio"], v["air.pressure"]
    # As ENTRIES, but for reciprocals and differences where they save work, and four more of the gas.
    v["converter.plunger_mass"] = 1 / v["converter.plunger_mass"]
    v["converter.atmosphere_area"] = pressure * v["converter.atmosphere_area"]
    v["diaphragm.mass"] = 1 / v["diaphragm.mass"]
    v["friction.static_force"] = v["friction.static_force"] - v["friction.coulomb_force"]
    v["friction.stribeck_velocity"] = 1 / v["friction.stribeck_velocity"]
    exponent = (1 / gamma, (2 / (gamma + 1)) ** (gamma / (gamma - 1)))
    more = (*exponent, 2 * gamma * v["air.gas_constant"] / (gamma - 1), 1 / v["air.temperature"])
    found = np.stack([*v.values(), *more], axis=-1)
    assert found.shape[-1] == COUNT
    return found


@compiled
def pull(c, pwm):
    """Magnetic force in N at a duty in percent; it is held between samples."""
    return (((c[11] * pwm + c[10]) * pwm + c[9]) * pwm + c[8]) * pwm + c[7]


@compiled
def rates(y, magnetic, reservoir, c):
    """Time derivatives of `(x_p, v_p, x_d, v_d, z, T_act, p_act)`."""
    x_p, v_p, x_d, v_d, z, temperature, pressure = y
    inv_m_p, k_mem, k_s1, b_p, a_act, push, a_res, _, _, _, _, _, slope, saturation, o0, o1, o2 = c[:17]
    volume, inv_m_d, a_d, preload, k_sm, b_d, travel, k_stop, d_stop = c[17:26]
    falling, f_c, sigma0, sigma1, sigma2, inv_v_s, _, gamma, p_atm, t_atm = c[26:36]
    inv_gamma, critical, flow_scale, inv_t_atm = c[36:]
    plunger = push - reservoir * a_res - pressure * a_act - magnetic - k_mem * x_p - b_p * v_p
    if x_p < 0:
        area, source = slope * min(-x_p, saturation), reservoir
    else:
        plunger -= k_s1 * x_p
        area, source = (o2 * x_p + o1) * x_p + o0, p_atm
    if source > pressure:
        upstream, ratio, hot, relative = source, pressure / source, t_atm, temperature * inv_t_atm
    else:
        area, upstream, ratio, hot, relative = -area, pressure, source / pressure, temperature, 1.0
    ratio = max(ratio, critical)
    root = math.exp(math.log(ratio) * inv_gamma)
    # R T_up times the mass flow; the largest of zero because rounding may go below it at equal pressures.
    heat = area * upstream * math.sqrt(flow_scale * max(root * (root - ratio), 0.0) * hot)
    inv_volume = 1 / (volume - a_d * x_d)
    work = pressure * a_d * v_d
    slide = sigma0 * abs(v_d) * z / (f_c + falling * math.exp(-abs(v_d) * inv_v_s))
    body = (p_atm - pressure) * a_d - preload - k_sm * x_d - (b_d + sigma2) * v_d
    body -= sigma0 * z + sigma1 * (v_d - slide)
    if x_d < 0:
        body -= k_stop * x_d * max(1 - d_stop * v_d, 0.0)
    elif x_d > travel:
        body -= k_stop * (x_d - travel) * max(1 + d_stop * v_d, 0.0)
    return (
        v_p,
        plunger * inv_m_p,
        v_d,
        body * inv_m_d,
        v_d - slide,
        temperature * ((gamma - relative) * heat + (gamma - 1) * work) * inv_volume / pressure,
        gamma * (heat + work) * inv_volume,
    )


@compiled
def at_rest(c, pwm, reservoir):
    """Start at ambient pressure and in static balance, for a trace that begins vented and with duty off."""
    k_mem, k_s1, a_act, push, a_res = c[1], c[2], c[4], c[5], c[6]
    preload, k_sm, k_stop, p_atm, t_atm = c[20], c[21], c[24], c[34], c[35]
    force = push - reservoir * a_res - p_atm * a_act - pull(c, pwm)
    lift = force / (k_mem + k_s1 if force > 0 else k_mem)
    position = -preload / (k_sm + k_stop if preload > 0 else k_sm)
    return (lift, 0.0, position, 0.0, 0.0, t_atm, p_atm)


@compiled
def moved(y, h, k):
    """States a time `h` on, at rates `k`."""
    return (
        y[0] + h * k[0],
        y[1] + h * k[1],
        y[2] + h * k[2],
        y[3] + h * k[3],
        y[4] + h * k[4],
        y[5] + h * k[5],
        y[6] + h * k[6],
    )


@compiled
def _step(y, h, magnetic, before, between, after, c):
    """One step of RK4, given the reservoir pressure at its start, middle and end."""
    k1 = rates(y, magnetic, before, c)
    k2 = rates(moved(y, 0.5 * h, k1), magnetic, between, c)
    k3 = rates(moved(y, 0.5 * h, k2), magnetic, between, c)
    k4 = rates(moved(y, h, k3), magnetic, after, c)
    ends = moved(moved(y, h / 6, k1), h / 6, k4)
    return moved(moved(ends, h / 3, k2), h / 3, k3)


@compiled
def run(row, time, pwm, reservoir, max_step, x_d, p_act):
    """Fills position and pressure at the samples; duty is held and reservoir pressure linear between them."""
    c = to_fixed_tuple(row, COUNT)
    y = at_rest(c, pwm[0], reservoir[0])
    for i in range(len(time) - 1):
        x_d[i], p_act[i] = y[2], y[6]
        magnetic = pull(c, pwm[i])
        length = time[i + 1] - time[i]
        substeps = max(1, math.ceil(length / max_step * (1 - 1e-9)))
        h = length / substeps
        slope = (reservoir[i + 1] - reservoir[i]) / substeps
        for j in range(substeps):
            before = reservoir[i] + slope * j
            y = _step(y, h, magnetic, before, before + 0.5 * slope, before + slope, c)
    x_d[-1], p_act[-1] = y[2], y[6]


@compiled
def run_each(rows, time, pwm, reservoir, max_step, x_d, p_act):
    """`run` for every row of constants, one after the other."""
    for j in range(len(rows)):
        run(rows[j], time, pwm, reservoir, max_step, x_d[j], p_act[j])


@njit(parallel=True, error_model="numpy")
def run_each_parallel(rows, time, pwm, reservoir, max_step, x_d, p_act):
    """`run_each` on all cores."""
    for j in prange(len(rows)):
        run(rows[j], time, pwm, reservoir, max_step, x_d[j], p_act[j])


def simulate(
    thetas: np.ndarray, trace: vgtjax.Trace, *, parallel: bool = False, max_step: float = 5e-4
) -> tuple[np.ndarray, np.ndarray]:
    """Position and pressure `(runs, time)` for parameters `(runs, parameters)`."""
    pwm, p_res = inputs(trace)
    rows = constants(np.atleast_2d(thetas))
    x_d, p_act = np.empty((2, len(rows), len(trace.time)))
    loop = run_each_parallel if parallel else run_each
    loop(rows, trace.time, pwm, p_res, max_step, x_d, p_act)
    return x_d, p_act
