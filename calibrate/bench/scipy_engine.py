"""Cylinders that empty into a manifold, as one would write it with SciPy."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_ivp

from vgtjax import get_parameter, parameter_table
from vgtjax.exhaust import Engine, OperatingPoint

State = Float[np.ndarray, "6"]
"""Mass in kg and temperature in K of the cylinder that opened last, of the one before, and of the manifold."""
Cycle = Float[np.ndarray, " crank"]
METHOD, TOLERANCE = "LSODA", 1e-10
"""Cylinder and manifold become equal within a degree, so a method for stiff equations."""
MOST_INTERVALS, SETTLED = 200, 1e-9
"""Firing intervals that are run out at most, and the relative change of all states over one at which it is done."""
CHORD = 0.9999
"""Pressure ratio above which flow is in proportion to the difference, as the package has it."""


@dataclasses.dataclass
class PlainEngine:
    """Cylinders whose exhaust valves open one after the other, and no more than two of them at once."""

    engine: Engine
    point: OperatingPoint

    def __post_init__(self) -> None:
        names = parameter_table(self.engine)
        self.of = {name: float(np.asarray(get_parameter(self.engine, name))) for name in names}
        self.area = float(np.asarray(self.point.effective_area))
        self.per_degree = 1 / (6 * float(np.asarray(self.point.engine_speed)))
        self.fresh = [float(np.asarray(value)) for value in (self.point.trapped_mass, self.point.opening_temperature)]
        self.outlet = float(np.asarray(self.point.outlet_pressure))

    def run_out(self) -> tuple[Cycle, int]:
        """Pressure in the manifold in Pa absolute over a firing interval, each half degree from the firing on, and the
        intervals that were run out until they repeated.

        **Raises:** `RuntimeError` when they don't, or SciPy fails.
        """
        opens, interval = self.of["valve.opening"], self.engine.interval
        manifold = [self.outlet * self.of["manifold_volume"] / (self.of["gas.gas_constant"] * self.fresh[1])]
        state = np.array([*self.fresh, *self.fresh, *manifold, self.fresh[1]])
        angles = np.arange(opens, opens + interval, 0.5)
        for count in range(1, MOST_INTERVALS + 1):
            end, pressures = self._interval(state, angles)
            after = np.concatenate([self.fresh, end[:2], end[4:]])
            if np.max(np.abs(after / state - 1)) < SETTLED:
                return np.roll(pressures, round(2 * opens)), count
            state = after
        raise RuntimeError(f"the engine does not repeat itself within {MOST_INTERVALS} firings")

    def _interval(self, state: State, angles: Cycle) -> tuple[State, Cycle]:
        """From the opening of a valve to that of the next."""
        shuts = self.of["valve.closing"] - self.engine.interval
        pressures, volume = [], self.of["manifold_volume"]
        # Restarted where the older cylinder shuts.
        for low, high in ((angles[0], shuts), (shuts, angles[0] + self.engine.interval)):
            inside = angles[(angles >= low) & (angles < high)]
            found = solve_ivp(
                self.slopes, (low, high), state, METHOD, [*inside, high], rtol=TOLERANCE, atol=TOLERANCE * state
            )
            if not found.success:
                raise RuntimeError(f"SciPy stopped: {found.message}")
            state = found.y[:, -1]
            pressures.append(self.of["gas.gas_constant"] * found.y[4, :-1] * found.y[5, :-1] / volume)
        return state, np.concatenate(pressures)

    def slopes(self, angle: float, state: State) -> State:
        """Per degree of the crank, `angle` deg after the firing of the cylinder that opened last."""
        gamma, constant = self.of["gas.heat_capacity_ratio"], self.of["gas.gas_constant"]
        mass, temperature = state[4:]
        pressure = constant * mass * temperature / self.of["manifold_volume"]
        gained, heated, slopes = 0.0, 0.0, np.empty(6)
        for place in (0, 1):
            turned = angle + place * self.engine.interval
            volume, growth = self._volume(turned)
            m, t = state[2 * place : 2 * place + 2]
            p = constant * m * t / volume
            flow = self._orifice(self._valve(turned), p, t, pressure, temperature)
            upstream = t if flow > 0 else temperature
            # m c_v T' = -p V' - w (c_p T_u - c_v T), over c_v.
            slopes[2 * place] = -flow
            slopes[2 * place + 1] = (-(gamma - 1) / constant * p * growth - flow * (gamma * upstream - t)) / m
            gained, heated = gained + flow, heated + flow * (gamma * upstream - temperature)
        leaving = self._orifice(self.area, pressure, temperature, self.outlet, temperature)
        wall = self.of["wall_conductance"] * (temperature - self.of["wall_temperature"]) * (gamma - 1) / constant
        slopes[4] = gained - leaving
        slopes[5] = (heated - leaving * (gamma - 1) * temperature - wall) / mass
        return slopes * self.per_degree

    def _volume(self, angle: float) -> tuple[float, float]:
        """Of a cylinder in m3, and its rate per second."""
        bore, radius, rod = (self.of[name] for name in ("bore", "crank_radius", "rod"))
        turned = np.radians(angle)
        long = np.sqrt(rod**2 - (radius * np.sin(turned)) ** 2)
        stroke = rod + radius * (1 - np.cos(turned)) - long
        slope = radius * np.sin(turned) * (1 + radius * np.cos(turned) / long)
        piston = np.pi / 4 * bore**2
        return self.of["clearance_volume"] + piston * stroke, piston * slope * np.pi / 180 / self.per_degree

    def _valve(self, angle: float) -> float:
        """Effective area in m2."""
        opens, shuts = self.of["valve.opening"], self.of["valve.closing"]
        if not opens < angle < shuts:
            return 0.0
        diameter = self.of["valve.diameter"]
        lift = self.of["valve.lift"] * np.sin(np.pi * (angle - opens) / (shuts - opens)) ** 2
        curtain, seat = np.pi * diameter * lift, np.pi / 4 * diameter**2
        return self.engine.valve.number * self.of["valve.discharge"] * curtain * seat / np.hypot(curtain, seat)

    def _orifice(self, area: float, before: float, temperature: float, behind: float, other: float) -> float:
        """kg/s, negative when the gas comes back."""
        if behind > before:
            return -self._orifice(area, behind, other, before, temperature)
        gamma, constant = self.of["gas.heat_capacity_ratio"], self.of["gas.gas_constant"]
        ratio = max(behind / before, (2 / (gamma + 1)) ** (gamma / (gamma - 1)))
        straight = (1 - ratio) / (1 - CHORD) if ratio > CHORD else 1.0
        ratio = min(ratio, CHORD)
        passed = 2 * gamma / (gamma - 1) * (ratio ** (2 / gamma) - ratio ** ((gamma + 1) / gamma))
        return area * before * straight * np.sqrt(passed / (constant * temperature))
