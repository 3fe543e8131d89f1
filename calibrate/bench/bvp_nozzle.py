"""Steady flow through a nozzle as one would write it with SciPy: ordinary differential equations between two ends."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.integrate import solve_bvp
from scipy.interpolate import PchipInterpolator

from vgtjax.turbine import Gas, Inlet, Passage, first_guess

Nodes = Float[np.ndarray, " nodes"]
States = Float[np.ndarray, "3 nodes"]
"""Meridional velocity in m/s, temperature in K, `r V_u` in m2/s."""
MOST_NODES = 20_000


class BoundaryValueNozzle:
    """Subsonic flow between a plenum and an outlet: its balances, solved for the slopes of velocity and temperature."""

    def __init__(self, passage: Passage, inlet: Inlet, outlet_pressure: float, gas: Gas):
        self.passage = Passage(*[np.asarray(getattr(passage, name)) for name in passage.__dataclass_fields__])
        self.total_pressure, self.total_temperature, self.tangent = (
            float(value) for value in (inlet.total_pressure, inlet.total_temperature, inlet.tangent)
        )
        self.outlet_pressure, self.gamma, self.constant = outlet_pressure, float(gas.gamma), float(gas.constant)
        self.heat_capacity = float(gas.heat_capacity)
        self.guess = first_guess(passage, inlet, gas)
        inside = np.asarray(passage.row) > 0
        # Ramps over a cell where rows begin and end, as the solver refines at a jump until it has no nodes left; beyond
        # the ends of a row its angle and speed go on.
        centres = np.asarray(self.passage.centres)
        nearest = np.flatnonzero(inside)[np.abs(centres[:, None] - centres[inside]).argmin(axis=1)]
        turning = np.where(inside, 1 / self.passage.length, 0.0)
        self.at_cells = self.passage.tangent[nearest], turning, self.passage.speed[nearest], self.passage.friction
        self.at_faces = PchipInterpolator(self.passage.m, np.stack([self.passage.area, self.passage.radius], axis=-1))

    def solve(self, tolerance: float) -> float:
        """Mass flow in kg/s.

        **Raises:** `RuntimeError` when SciPy finds none.
        """
        m, centres = np.asarray(self.passage.m), self.passage.centres
        density, velocity, swirl, pressure = np.moveaxis(np.asarray(self.guess), -1, 0)
        columns = velocity, np.exp(pressure - density) / self.constant, swirl
        start = np.stack([np.interp(m, centres, column) for column in columns])
        mass_flow = float(np.exp(density[0]) * velocity[0] * self.passage.area[0])
        found = solve_bvp(self.slopes, self.missing, m, start, [mass_flow], tol=tolerance, max_nodes=MOST_NODES)
        if not found.success:
            raise RuntimeError(found.message)
        return float(found.p[0])

    def slopes(self, m: Nodes, states: States, unknown: Nodes) -> States:
        """Over the distance along the passage."""
        velocity, temperature, swirl = states
        area, radius, d_area, d_radius, speed, f_u, f_m = self._at(m, states)
        d_swirl = radius * f_u / velocity
        around = swirl / radius
        d_around = (d_swirl - around * d_radius) / radius
        # Momentum with p = rho R T and rho = q / (V S), energy with h = c_p T: two equations for two slopes.
        pushed = around**2 / radius * d_radius + f_m
        gained = speed * d_swirl - around * d_around
        pressure_term = self.constant * temperature
        a, b = velocity - pressure_term / velocity, self.constant
        right = pushed + pressure_term * d_area / area
        d_velocity = (right - b * gained / self.heat_capacity) / (a - b * velocity / self.heat_capacity)
        return np.stack([d_velocity, (gained - velocity * d_velocity) / self.heat_capacity, d_swirl])

    def missing(self, first: Nodes, last: Nodes, unknown: Nodes) -> Nodes:
        """What the ends lack: no loss from the plenum, its direction, its enthalpy; the outlet's pressure."""
        velocity, temperature, swirl = first
        passage = self.passage
        pressure = self._pressure(unknown[0], first, float(passage.area[0]))
        expanded = self.total_pressure * (temperature / self.total_temperature) ** (self.gamma / (self.gamma - 1))
        kinetic = 0.5 * velocity**2 * (1 + self.tangent**2)
        behind = self._pressure(unknown[0], last, float(passage.area[-1]))
        return np.array(
            [
                pressure / expanded - 1,
                (temperature + kinetic / self.heat_capacity) / self.total_temperature - 1,
                swirl / (float(passage.radius[0]) * 400.0) - velocity * self.tangent / 400.0,
                behind / self.outlet_pressure - 1,
            ]
        )

    def _pressure(self, mass_flow: float, state: Nodes, area: float) -> Any:
        return mass_flow * self.constant * state[1] / (state[0] * area)

    def _at(self, m: Nodes, states: States) -> tuple[Nodes, ...]:
        """Area and radius with their slopes, the row's speed, and the forces on the gas in N/kg."""
        passage, at_cells, at_faces = self.passage, self.at_cells, self.at_faces
        area, radius = at_faces(m).T
        d_area, d_radius = at_faces(m, 1).T
        velocity, _, swirl = states
        tangent, turning, speed, friction = (np.interp(m, passage.centres, values) for values in at_cells)
        relative = swirl / radius - radius * speed
        turned = (velocity * tangent - relative) * turning
        drag = 0.5 * friction * np.hypot(velocity, relative)
        around, along = turned * velocity - drag * relative, -turned * relative - drag * velocity
        return area, radius, d_area, d_radius, speed, around, along
