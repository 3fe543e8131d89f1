"""What the moment on a vane is late by while the pressure before it moves, by another method: the equations of unsteady
flow along `m`, marched by SciPy's LSODA with their rates as sources. To first order in the rate of the pressure these
are those of steady flows that it passes through. Geometry is that of `marching`, cells it has none.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from .marching import BEFORE_SONIC, CP, GAMMA, HEIGHT, LEAD, RATIO, T0, TRAIL, VANES, VOLUTE, R, parts_of

SHARE = (GAMMA - 1) / GAMMA
STILL = (0.0,) * 5
APART = 20.0
"""Pa to either side at which steady flows are looked at."""


def fields(part, x, y):
    """Density, `V_m`, `r V_u`, pressure and total enthalpy of what `slopes` marches."""
    velocity, swirl, enthalpy, passing, _ = y
    density = passing / (velocity * part.area(x)[0])
    static = enthalpy - 0.5 * (velocity**2 + (swirl / part.radius(x)[0]) ** 2)
    return np.array([density, velocity, swirl, density * SHARE * static, enthalpy])


def slopes(part, rates):
    """Right side: `V_m`, `r V_u`, total enthalpy, mass flow and the moment on a vane, over the share of the part;
    `rates` are those of `fields` in a second."""

    def right(x, y):
        velocity, swirl, enthalpy, passing, _ = y
        (r, dr), (area, d_area) = part.radius(x), part.area(x)
        density_rate, velocity_rate, swirl_rate, pressure_rate, enthalpy_rate = rates(x)
        around, density = swirl / r, passing / (velocity * area)
        static = enthalpy - 0.5 * (velocity**2 + around**2)
        blade_u = blade_m = drag = relative = 0.0
        if part.tangent is not None:
            relative = around - r * part.speed
            blade_u = velocity * (velocity * part.tangent(x) - relative) / (part.loading * part.length)
            blade_m = -blade_u * relative / velocity
            drag = 0.5 * part.friction * np.hypot(velocity, relative)
        turning = r * (blade_u - drag * relative)
        d_passing = -part.length * area * density_rate
        d_swirl = part.length * (turning - swirl_rate) / velocity
        d_enthalpy = part.length * (part.speed * turning + pressure_rate / density - enthalpy_rate) / velocity
        # Of the enthalpy at rest along the meridian, but for what the meridional velocity changes.
        warmer = static * (d_passing / passing - d_area / area) + d_enthalpy
        warmer += -swirl * d_swirl / r**2 + swirl**2 * dr / r**3
        pushed = part.length * (blade_m - drag * velocity - velocity_rate) + swirl**2 * dr / r**3 - SHARE * warmer
        d_velocity = pushed / (velocity - SHARE * (static / velocity + velocity))
        normal = passing / velocity * blade_u * np.hypot(1.0, around / velocity) * part.length / VANES
        return d_velocity, d_swirl, d_enthalpy, d_passing, normal * (x * (LEAD + TRAIL) - LEAD)

    return right


def marched(parts, velocity, total_pressure, rates):
    """Pressure at the outlet, moment on a vane, and states over the share of each part, of gas that comes in at a
    velocity; None if it does not pass."""
    tangent = 2 * np.pi * HEIGHT / RATIO
    ratio = 1 - 0.5 * velocity**2 * (1 + tangent**2) / (CP * T0)
    passing = total_pressure / (R * T0) * ratio ** (1 / (GAMMA - 1)) * velocity * 2 * np.pi * VOLUTE * HEIGHT
    y, moment, along = np.array([velocity, VOLUTE * velocity * tangent, CP * T0, passing, 0.0]), 0.0, []
    for number, part in enumerate(parts):

        def slow(x, y, part=part):
            density, velocity, _, pressure, _ = fields(part, x, y)
            return BEFORE_SONIC**2 * GAMMA * pressure / density - velocity**2

        slow.terminal = True
        y[4] = 0.0
        right = slopes(part, rates[number])
        gone = solve_ivp(right, (0.0, 1.0), y, "LSODA", rtol=1e-9, atol=1e-9, events=slow, dense_output=True)
        if gone.status != 0:
            return None
        y = gone.y[:, -1].copy()
        moment = y[4] if number == 1 else moment
        along.append(gone.sol)
    return fields(parts[-1], 1.0, y)[3], moment, along


def passed(parts, total_pressure, outlet_pressure, rates, velocities):
    """Velocity at the inlet, between two, at which the outlet's pressure is met, and what `marched` finds there."""

    def missed(velocity):
        found = marched(parts, velocity, total_pressure, rates)
        return -1.0 if found is None else found[0] / outlet_pressure - 1

    velocity = brentq(missed, *velocities, xtol=1e-10)
    found = marched(parts, velocity, total_pressure, rates)
    assert found is not None
    assert abs(found[0] / outlet_pressure - 1) < 1e-6  # met, not passed by at a velocity that is too much
    return velocity, found


def late_moment(phi, speed, friction, total_pressure, outlet_pressure, rate):
    """By how much the moment on a vane in N m is above that of steady flow while the plenum's pressure rises at a rate
    in Pa/s."""
    parts = parts_of(phi, speed, friction)
    still, most = [lambda x: STILL] * len(parts), np.sqrt(2 * CP * T0 / (1 + (2 * np.pi * HEIGHT / RATIO) ** 2)) * 0.5
    (_, below), (velocity, above) = (
        passed(parts, total_pressure + side * APART, outlet_pressure, still, (1e-3 * most, most)) for side in (-1, 1)
    )

    def rates(part, first, last):
        return lambda x: (fields(part, x, last(x)) - fields(part, x, first(x))) * rate / (2 * APART)

    moving = [rates(*each) for each in zip(parts, below[2], above[2], strict=True)]
    _, unsteady = passed(parts, total_pressure, outlet_pressure, moving, (0.97 * velocity, 1.03 * velocity))
    return unsteady[1] - 0.5 * (below[1] + above[1])
