"""Steady flow through the nozzle as one would write it with SciPy: a shooting method along the passage."""

import numpy as np
import scipy.integrate
import scipy.optimize
from jaxtyping import Float

from vgtjax.turbine import Gas, Inlet, Passage

Along = Float[np.ndarray, " m"]
States = Float[np.ndarray, "3 m"]
"""`r V_u` in m2/s, entropy in J/(kg K) and total enthalpy in J/kg."""
HALVINGS = 60
"""Of the interval in which the velocity is sought."""
SONIC_SHARE = 0.999
"""Of the speed of sound up to which that interval goes: the problem has no place for a shock."""


class NozzleProblem:
    """Swirl, entropy and total enthalpy over the distance, the mass flow unknown; subsonic along the meridian."""

    def __init__(self, passage: Passage, inlet: Inlet, outlet_pressure: float, gas: Gas):
        self.faces, self.radius, self.area = (np.asarray(each) for each in (passage.m, passage.radius, passage.area))
        names = ("row", "tangent", "length", "speed", "friction")
        self.cells = {name: np.asarray(getattr(passage, name)) for name in names}
        self.gamma, self.constant, self.capacity = (
            float(each) for each in (gas.gamma, gas.constant, gas.heat_capacity)
        )
        self.pressure, self.tangent = float(inlet.total_pressure), float(inlet.tangent)
        self.enthalpy = self.capacity * float(inlet.total_temperature)
        self.outlet_pressure = outlet_pressure

    def solve(self, guess: float, tolerance: float) -> float:
        """Mass flow in kg/s, searched from a guess by marches with so much relative tolerance."""
        return float(scipy.optimize.fsolve(lambda flow: self._missed(float(flow[0]), tolerance), [guess])[0])

    def _missed(self, flow: float, tolerance: float) -> float:
        """Pressure at the end over what it should be, less one, for a mass flow in kg/s."""
        entering = self._entering(flow)
        first = [self.radius[0] * entering * self.tangent, 0.0, self.enthalpy]
        across = self.faces[0], self.faces[-1]
        marched = scipy.integrate.solve_ivp(
            lambda m, states: self._rates(np.array([m]), states[:, None], flow)[:, 0],
            across,
            first,
            method="LSODA",
            rtol=tolerance,
            atol=[tolerance, tolerance, tolerance * self.enthalpy],
        )
        leaving = self._gas(self.faces[-1:], marched.y[:, -1:], flow)[2][0]
        return float(leaving / self.outlet_pressure - 1)

    def _entering(self, flow: float) -> float:
        """Meridional velocity in m/s at the inlet, where swirl goes with it."""

        def missing(velocity: float) -> float:
            hottest = np.array([self.enthalpy - 0.5 * (velocity * self.tangent) ** 2])
            density = self._density(hottest, np.array([velocity]), np.zeros(1))[0]
            return float(density * velocity * self.area[0] - flow)

        return float(scipy.optimize.brentq(missing, 1e-3, 200.0))

    def _rates(self, m: Along, states: States, flow: float) -> States:
        inside = np.clip(np.searchsorted(self.faces, m, side="right") - 1, 0, self.faces.size - 2)
        at = {name: values[inside] for name, values in self.cells.items()}
        radius = np.interp(m, self.faces, self.radius)
        velocity, temperature, _ = self._gas(m, states, flow)
        relative = states[0] / radius - radius * at["speed"]
        turned = np.where(at["row"] > 0, (velocity * at["tangent"] - relative) / at["length"], 0.0)
        whole = np.hypot(velocity, relative)
        swirl = radius * (turned - 0.5 * at["friction"] * whole * relative / velocity)
        entropy = at["friction"] * whole**3 / (2 * velocity * temperature)
        return np.stack([swirl, entropy, at["speed"] * swirl])

    def _gas(self, m: Along, states: States, flow: float) -> tuple[Along, Along, Along]:
        """Meridional velocity, temperature and pressure that pass the flow; by bisection, as it is subsonic."""
        swirl, entropy, total = states
        radius, area = (np.interp(m, self.faces, values) for values in (self.radius, self.area))
        hottest = np.maximum(total - 0.5 * (swirl / radius) ** 2, 0.1 * self.enthalpy)
        low = np.full_like(hottest, 1e-3)
        high = SONIC_SHARE * np.sqrt(2 * hottest * (self.gamma - 1) / (self.gamma + 1))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            too_slow = self._density(hottest, middle, entropy) * middle * area < flow
            low, high = np.where(too_slow, middle, low), np.where(too_slow, high, middle)
        temperature = (hottest - 0.5 * low**2) / self.capacity
        return low, temperature, self._density(hottest, low, entropy) * self.constant * temperature

    def _density(self, hottest: Along, velocity: Along, entropy: Along) -> Along:
        cooled = (hottest - 0.5 * velocity**2) / self.enthalpy
        at_rest = self.pressure * self.capacity / (self.constant * self.enthalpy)
        return at_rest * cooled ** (1 / (self.gamma - 1)) * np.exp(-entropy / self.constant)
