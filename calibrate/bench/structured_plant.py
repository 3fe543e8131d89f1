"""The plant of the benchmarks with what `compare` has to find: a duty that is linear between samples, a squared
Stribeck curve, and a force of the exhaust gas that changes sides with the rod's speed or along its way.

A plant of its own, so that the loop that is timed decides nothing: the equations are those of `numba_plant`, in which a
vane force acts as the preload does, and a squared Stribeck curve is one whose velocity depends on the speed. The force
is a smooth function of the crank angle, not the table that this package has.
"""

import dataclasses
import math
from typing import Literal

import numpy as np
from jaxtyping import Float
from numba.np.unsafe.ndarray import to_fixed_tuple

import vgtjax
from vgtjax.parts import Crank

from . import numba_plant
from .numba_plant import COUNT, compiled

Hold = Literal["zero-order", "linear"]
VaneLaw = Literal["none", "map", "speed-map"]
FAR, DECAY = 0.35, 12.0
"""What is left of the force with the vanes wide open, and the crank angle in deg over which the rest falls."""
GAS = 8
"""Constants of the structure; numba unrolls the tuple of them."""
BAR = 1e5
"""Pa"""


@dataclasses.dataclass(frozen=True)
class Structure:
    """What the plant is made of, in the words of `compare`: the duty's hold, the exponent of the Stribeck curve [3.7,
    5.62], and how the vane force changes sides [3.16, 3.17]: over a distance (`map`), with the speed, or there is
    none."""

    duty_hold: Hold = "zero-order"
    stribeck_exponent: Literal[1, 2] = 1
    vane_force: VaneLaw = "none"


@dataclasses.dataclass(frozen=True)
class Gas:
    """Force on closing and on opening vanes at the closed stop in N/bar, and over which speed (m/s) or distance (m) it
    goes from one to the other."""

    closing: float = 2.6
    opening: float = 1.6
    side_speed: float = 1e-3
    reversal_distance: float = 65e-6


def simulate(
    unit: vgtjax.Actuator,
    structure: Structure,
    gas: Gas,
    inputs: tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"], Float[np.ndarray, " time"]],
    turbine_pressure: float,
    max_step: float,
) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Position in m and chamber pressure in Pa at the samples, from rest.

    **Arguments:** `unit` with LuGre friction, whose own exponent and vane force don't count; `inputs`: time in s, duty
    in % and reservoir pressure in Pa; `turbine_pressure` in Pa gauge; `max_step` in s.
    """
    time, pwm, reservoir = inputs
    x_d, p_act = np.empty((2, len(time)))
    row = numba_plant.constants(numba_plant.pack(unit))
    linear = structure.duty_hold == "linear"
    run(row, constants(structure, gas, turbine_pressure), time, pwm, reservoir, linear, max_step, x_d, p_act)
    return x_d, p_act


def constants(structure: Structure, gas: Gas, turbine_pressure: float) -> Float[np.ndarray, " constants"]:
    """What the right side needs of a structure: forces at a turbine pressure in Pa gauge, and reciprocals."""
    crank = Crank()
    bar = 0.0 if structure.vane_force == "none" else turbine_pressure / BAR
    return np.array(
        [
            structure.stribeck_exponent == 2,
            structure.vane_force == "map",
            0.5 * bar * (gas.closing - gas.opening),
            0.5 * bar * (gas.closing + gas.opening),
            1 / gas.side_speed,
            1 / gas.reversal_distance,
            float(crank.ratio),
            float(crank.offset),
        ]
    )


@compiled
def gas_force(position, direction, c, gas):
    """Force in N against closing, at a position in m and a direction from -1 (opening) to 1 (closing)."""
    mean, half, ratio, offset = gas[2], gas[3], gas[6], gas[7]
    angle = (c[23] - position) * ratio + offset
    return (FAR + (1 - FAR) * math.exp(-angle / DECAY)) * (mean + direction * half)


@compiled
def loaded(c, force, velocity, gas):
    """Constants of `numba_plant` with a force more on the rod, and the Stribeck curve of this velocity in m/s."""
    inv_v_s = c[31]
    if gas[0] > 0:
        inv_v_s *= abs(velocity) * inv_v_s
    return (*c[:20], c[20] + force, *c[21:31], inv_v_s, *c[32:])


@compiled
def rates(y, magnetic, reservoir, c, gas):
    """Time derivatives of the plant's seven states and of the direction, which follows the way of the rod."""
    velocity, direction = y[3], y[7]
    turning = (velocity - abs(velocity) * direction) * gas[5]
    if gas[1] == 0:
        direction = math.tanh(velocity * gas[4])
    force = gas_force(y[2], direction, c, gas)
    return (*numba_plant.rates(y[:7], magnetic, reservoir, loaded(c, force, velocity, gas)), turning)


@compiled
def at_rest(c, pwm, reservoir, gas):
    """Vented, in static balance with the vanes open, between the directions."""
    return (*numba_plant.at_rest(loaded(c, gas_force(0.0, 0.0, c, gas), 0.0, gas), pwm, reservoir), 0.0)


@compiled
def _moved(y, h, k):
    return (*numba_plant.moved(y[:7], h, k[:7]), y[7] + h * k[7])


@compiled
def _step(y, h, magnetic, reservoir, c, gas):
    """One step of RK4, given magnetic force and reservoir pressure at its start, middle and end."""
    k1 = rates(y, magnetic[0], reservoir[0], c, gas)
    k2 = rates(_moved(y, 0.5 * h, k1), magnetic[1], reservoir[1], c, gas)
    k3 = rates(_moved(y, 0.5 * h, k2), magnetic[1], reservoir[1], c, gas)
    k4 = rates(_moved(y, h, k3), magnetic[2], reservoir[2], c, gas)
    ends = _moved(_moved(y, h / 6, k1), h / 6, k4)
    return _moved(_moved(ends, h / 3, k2), h / 3, k3)


@compiled
def run(row, structure, time, pwm, reservoir, linear, max_step, x_d, p_act):
    """Fills position and pressure at the samples; reservoir pressure is linear between them, duty as well or held."""
    c, gas = to_fixed_tuple(row, COUNT), to_fixed_tuple(structure, GAS)
    y = at_rest(c, pwm[0], reservoir[0], gas)
    for i in range(len(time) - 1):
        x_d[i], p_act[i] = y[2], y[6]
        length = time[i + 1] - time[i]
        substeps = max(1, math.ceil(length / max_step * (1 - 1e-9)))
        rise = (pwm[i + 1] - pwm[i]) / substeps if linear else 0.0
        slope = (reservoir[i + 1] - reservoir[i]) / substeps
        for j in range(substeps):
            duty, before = pwm[i] + rise * j, reservoir[i] + slope * j
            magnetic = (
                numba_plant.pull(c, duty),
                numba_plant.pull(c, duty + 0.5 * rise),
                numba_plant.pull(c, duty + rise),
            )
            y = _step(y, length / substeps, magnetic, (before, before + 0.5 * slope, before + slope), c, gas)
    x_d[-1], p_act[-1] = y[2], y[6]
