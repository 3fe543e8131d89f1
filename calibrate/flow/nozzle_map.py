"""The map of a nozzle: steady flow over pressure and crank angle, and what it does to shaft, vanes and rod."""

import csv
import dataclasses
import io
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from vgtjax.parts import CRANK_RANGE, HIGHEST_PRESSURE, Stage, no_steady_flow
from vgtjax.turbine import Inlet, Passage, PassageFlow, States, steady_near

PRESSURES, ANGLES = 10, 10
QUANTITIES = {
    "mass_flow": "kg/s",
    "power": "W",
    "vane_moment": "N m",
    "normal_force": "N",
    "rod_force": "N",
}
"""What a map says, and its unit; the moment, positive opening, and the normal force, positive inwards, are those of one
vane."""

Table = Float[np.ndarray, "pressures angles"]


@dataclasses.dataclass(frozen=True, eq=False)
class NozzleMap:
    """Steady states over total pressure in Pa absolute and crank angle in deg."""

    stage: Stage
    total_pressure: Float[np.ndarray, " pressures"]
    crank_angle: Float[np.ndarray, " angles"]
    values: dict[str, Table]
    """By the names of [`QUANTITIES`][]."""

    @property
    def pressure_ratio(self) -> Float[np.ndarray, " pressures"]:
        """Total pressure before the turbine over the pressure behind it."""
        return self.total_pressure / float(self.stage.outlet_pressure)

    def to_csv(self) -> str:
        """One line per point."""
        heads = ["pressure_ratio [-]", "total_pressure [Pa abs]", "crank_angle [deg]", "vane_angle [deg]"]
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*heads, *(f"{name} [{unit}]" for name, unit in QUANTITIES.items())])
        for row, pressure in enumerate(self.total_pressure):
            for column, angle in enumerate(self.crank_angle):
                vanes = np.degrees(float(self.stage.vane_angle(angle)))
                found = (self.values[name][row, column] for name in QUANTITIES)
                line = (self.pressure_ratio[row], pressure, angle, vanes, *found)
                writer.writerow([f"{value:.9g}" for value in line])
        return text.getvalue()

    def summary(self) -> dict[str, Any]:
        """Its range, and the smallest and the largest of every quantity with where they are."""
        extremes = {}
        for name, table in self.values.items():
            extremes[name] = {
                "unit": QUANTITIES[name],
                **{kind: self._at(table, place(table)) for kind, place in (("least", np.argmin), ("most", np.argmax))},
            }
        return {
            "points": self.total_pressure.size * self.crank_angle.size,
            "total_pressure": [float(self.total_pressure[0]), float(self.total_pressure[-1])],
            "crank_angle": [float(self.crank_angle[0]), float(self.crank_angle[-1])],
            "outlet_pressure": float(self.stage.outlet_pressure),
            "total_temperature": float(self.stage.total_temperature),
            "quantities": extremes,
        }

    def _at(self, table: Table, place: Any) -> dict[str, float]:
        row, column = np.unravel_index(int(place), table.shape)
        return {
            "value": float(table[row, column]),
            "total_pressure": float(self.total_pressure[row]),
            "crank_angle": float(self.crank_angle[column]),
        }


def solve_map(stage: Stage) -> NozzleMap:
    """The map of a stage from a little above the outlet's pressure.

    **Raises:** `SimulationError` that names the first point at which no steady state is found.
    """
    outlet = float(stage.outlet_pressure)
    pressures = outlet + (HIGHEST_PRESSURE - outlet) * np.arange(1, PRESSURES + 1) / PRESSURES
    angles = np.linspace(*CRANK_RANGE, ANGLES)
    values, found = _solve(stage, jnp.asarray(pressures), jnp.asarray(angles))
    if not np.all(found):
        column, row = np.argwhere(~found)[0]
        raise no_steady_flow(stage, pressures[row], angles[column])
    tables = {name: table.T for name, table in zip(QUANTITIES, values, strict=True)}
    return NozzleMap(stage, pressures, angles, tables)


def solve_point(
    stage: Stage, total_pressure: Array, crank_angle: Array, near: States | None = None
) -> tuple[Passage, PassageFlow, States]:
    """Steady flow at Pa absolute and deg, what it flows through, and states to search its neighbour from."""
    passage, inlet = _passage(stage, total_pressure, crank_angle)
    return passage, *steady_near(passage, inlet, stage.outlet_pressure, stage.gas, near)


def _solve(
    stage: Stage, pressures: Array, angles: Array
) -> tuple[list[Float[np.ndarray, "angles pressures"]], Bool[np.ndarray, "angles pressures"]]:
    """Quantities and whether they were found, angle by angle, each point searched from the one below it."""
    values, found = [], []
    for angle in angles:
        near = None
        for pressure in pressures:
            passage, flow, states = solve_point(stage, pressure, angle, near)
            values.append(_quantities(stage, passage, flow))
            found.append(bool(flow.converged))
            near = states if found[-1] else near
    shape = len(angles), len(pressures)
    return [np.reshape(each, shape) for each in zip(*values, strict=True)], np.reshape(found, shape)


@eqx.filter_jit
def _passage(stage: Stage, total_pressure: Array, crank_angle: Array) -> tuple[Passage, Inlet]:
    return stage.passage(total_pressure, crank_angle)


@eqx.filter_jit
def _quantities(stage: Stage, passage: Passage, flow: PassageFlow) -> tuple[Array, ...]:
    """In the order of [`QUANTITIES`][]."""
    moment, normal = stage.nozzle.vane_moment(passage, flow)
    return flow.mass_flow, flow.power, moment, normal, stage.force(moment)
