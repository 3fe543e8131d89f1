"""Steady flow through a nozzle by another method: ordinary differential equations along `m` (SciPy's LSODA) from the
volute to the duct, and a root for the velocity at the inlet. It shares neither cells nor geometry with the package;
what friction a row has is given.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

GAMMA, R, T0 = 1.34, 287.0, 900.0
CP = GAMMA * R / (GAMMA - 1)
PIVOT, LEAD, TRAIL, THICKNESS, HEIGHT, VANES = 25.5e-3, 7e-3, 7.6e-3, 0.3e-3, 6.5e-3, 11
VOLUTE, RATIO = 36e-3, 18e-3
WHEEL_IN, WHEEL_OUT, PATH, OUT_AREA, OUT_TANGENT, TAIL = 19e-3, 12e-3, 18e-3, 700e-6, np.tan(np.radians(-58.0)), 10e-3
BEFORE_SONIC = 0.999
"""Meridional Mach number at which marching ends: no steady flow passes so much."""


def step(x):
    """From 0 to 1, level at both ends, and its slope."""
    x = np.clip(x, 0.0, 1.0)
    return x**2 * (3 - 2 * x), 6 * x * (1 - x)


@dataclasses.dataclass(frozen=True)
class Part:
    """Of the passage: everything as a function of the share of its length."""

    length: float
    """m"""
    radius: Callable
    """In m, and its slope over the share."""
    area: Callable
    """In m2, and its slope over the share."""
    tangent: Callable | None = None
    """Of the blades' angle; without blades none."""
    loading: float = 1.0
    """Share over which gas takes that angle."""
    speed: float = 0.0
    """rad/s"""
    friction: float = 0.0
    """1/m"""


def parts_of(phi, speed, friction):
    """Volute, vanes, gap, wheel and duct with vanes at an angle in rad, a wheel in rad/s, friction of both in 1/m."""
    pitch = 2 * np.pi / VANES
    leading = np.sqrt(PIVOT**2 + LEAD**2 + 2 * PIVOT * LEAD * np.sin(phi))
    trailing = np.sqrt(PIVOT**2 + TRAIL**2 - 2 * PIVOT * TRAIL * np.sin(phi))
    throat = PIVOT * (np.cos(phi) - np.cos(phi + pitch)) - TRAIL * np.sin(pitch) - THICKNESS
    begin = np.tan(np.arcsin(PIVOT * np.cos(phi) / leading))
    end = np.tan(np.arccos(throat / (pitch * trailing)))

    def inwards(first, last, **row):
        return Part(
            first - last,
            lambda x: (first + (last - first) * x, last - first),
            lambda x: (2 * np.pi * HEIGHT * (first + (last - first) * x), 2 * np.pi * HEIGHT * (last - first)),
            **row,
        )

    entrance = 2 * np.pi * WHEEL_IN * HEIGHT
    wheel = Part(
        PATH,
        lambda x: (
            WHEEL_IN + (WHEEL_OUT - WHEEL_IN) * (1 - np.cos(np.pi * x / 2)),
            (WHEEL_OUT - WHEEL_IN) * np.pi / 2 * np.sin(np.pi * x / 2),
        ),
        lambda x: (entrance + (OUT_AREA - entrance) * step(x)[0], (OUT_AREA - entrance) * step(x)[1]),
        lambda x: OUT_TANGENT * x**2,
        0.12,
        speed,
        friction[1],
    )
    turning = {"tangent": lambda x: begin + (end - begin) * step(x / 0.7)[0], "loading": 0.08, "friction": friction[0]}
    return [
        inwards(VOLUTE, leading),
        inwards(leading, trailing, **turning),
        inwards(trailing, WHEEL_IN),
        wheel,
        Part(TAIL, lambda x: (WHEEL_OUT, 0.0), lambda x: (OUT_AREA, 0.0)),
    ]


def slopes(part, mass_flow):
    """Right side: `V_m`, `r V_u`, total enthalpy and the moment on a vane, over the share of the part."""

    def right(x, y):
        velocity, swirl, enthalpy, _ = y
        (r, dr), (area, d_area) = part.radius(x), part.area(x)
        around = swirl / r
        sound = np.sqrt((GAMMA - 1) * (enthalpy - 0.5 * (velocity**2 + around**2)))
        blade_u = blade_m = drag = relative = 0.0
        if part.tangent is not None:
            relative = around - r * part.speed
            blade_u = velocity * (velocity * part.tangent(x) - relative) / (part.loading * part.length)
            blade_m = -blade_u * relative / velocity
            drag = 0.5 * part.friction * np.hypot(velocity, relative)
        heating = drag * (velocity**2 + relative**2) / velocity
        # Momentum with continuity and `dp = a^2 d rho + (gamma - 1) rho T ds` put in.
        pushed = part.length * (blade_m - drag * velocity - (GAMMA - 1) * heating)
        pushed += sound**2 * d_area / area + swirl**2 / r**3 * dr
        d_swirl = part.length * r * (blade_u - drag * relative) / velocity
        # Density times area is the mass flow over the velocity.
        normal = mass_flow / velocity * blade_u * np.hypot(1.0, around / velocity) * part.length / VANES
        lever = x * (LEAD + TRAIL) - LEAD
        return pushed / (velocity - sound**2 / velocity), d_swirl, part.speed * d_swirl, normal * lever

    return right


def marched(parts, velocity, total_pressure):
    """Pressure at the outlet, mass flow, power and moment on a vane, of gas that comes in at a velocity; None if it
    does not pass."""
    tangent, r = 2 * np.pi * HEIGHT / RATIO, VOLUTE
    ratio = 1 - 0.5 * velocity**2 * (1 + tangent**2) / (CP * T0)
    density = total_pressure / (R * T0) * ratio ** (1 / (GAMMA - 1))
    mass_flow = density * velocity * 2 * np.pi * r * HEIGHT
    y, moment = np.array([velocity, r * velocity * tangent, CP * T0, 0.0]), 0.0
    for number, part in enumerate(parts):

        def slow(x, y, part=part):
            sound = (GAMMA - 1) * (y[2] - 0.5 * (y[0] ** 2 + (y[1] / part.radius(x)[0]) ** 2))
            return BEFORE_SONIC**2 * sound - y[0] ** 2

        slow.terminal = True
        y[3] = 0.0
        gone = solve_ivp(slopes(part, mass_flow), (0.0, 1.0), y, "LSODA", rtol=1e-9, atol=1e-9, events=slow)
        if gone.status != 0:
            return None
        y = gone.y[:, -1]
        moment = y[3] if number == 1 else moment
    r, area = parts[-1].radius(1.0)[0], parts[-1].area(1.0)[0]
    temperature = (y[2] - 0.5 * (y[0] ** 2 + (y[1] / r) ** 2)) / CP
    return mass_flow / (y[0] * area) * R * temperature, mass_flow, mass_flow * (CP * T0 - y[2]), moment


def solution(phi, speed, friction, total_pressure, outlet_pressure):
    """Mass flow in kg/s, power in W and moment on a vane in N m, where the outlet's pressure is met."""
    parts = parts_of(phi, speed, friction)

    def missed(velocity):
        found = marched(parts, velocity, total_pressure)
        return -1.0 if found is None else found[0] / outlet_pressure - 1

    most = np.sqrt(2 * CP * T0 / (1 + (2 * np.pi * HEIGHT / RATIO) ** 2)) * 0.5
    velocity = brentq(missed, 1e-3 * most, most, xtol=1e-9)
    found = marched(parts, velocity, total_pressure)
    assert found is not None
    assert abs(found[0] / outlet_pressure - 1) < 1e-5  # met, not passed by at a velocity that is too much
    return found[1:]


def choked_flow(phi, speed, friction, total_pressure):
    """Most mass flow in kg/s that passes: with more, gas is as fast as sound along the meridian before the end."""
    parts = parts_of(phi, speed, friction)
    passes, most = 0.0, np.sqrt(2 * CP * T0 / (1 + (2 * np.pi * HEIGHT / RATIO) ** 2)) * 0.5
    while most - passes > 1e-9:
        velocity = 0.5 * (passes + most)
        found = marched(parts, velocity, total_pressure)
        passes, most = (passes, velocity) if found is None else (velocity, most)
    return marched(parts, passes, total_pressure)[1]
