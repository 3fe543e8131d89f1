"""The flow along the passage at a few crank angles, and the load of a vane."""

import csv
import dataclasses
import io

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from vgtjax.parts import HIGHEST_PRESSURE, Stage, no_steady_flow
from vgtjax.turbine import VANES, Passage, PassageFlow

from .nozzle_map import solve_point

SHARE, CRANK_ANGLES = 0.95 / 3.45, (6.0, 12.0, 25.0)
"""Of the pressures between the outlet's and the highest, which is 2 bar above an outlet at 1.05 bar, and deg of what is
shown."""
HEADS = (
    "crank_angle [deg]",
    "m [m]",
    "radius [m]",
    "row",
    "mach_number [-]",
    "v_m [m/s]",
    "v_u [m/s]",
    "swirl [m2/s]",
    "pressure [Pa abs]",
    "temperature [K]",
)

Cells = Float[np.ndarray, " cells"]


@dataclasses.dataclass(frozen=True, eq=False)
class Along:
    """Steady flow at a pressure and a crank angle in deg."""

    stage: Stage
    total_pressure: float
    """Pa absolute."""
    crank_angle: float
    passage: Passage
    flow: PassageFlow

    @property
    def row(self) -> Cells:
        """Which row of blades a cell belongs to."""
        return np.asarray(self.passage.row)

    @property
    def mach_number(self) -> Cells:
        """Of the whole velocity, in the absolute frame."""
        speed = np.hypot(self.flow.v_m, self.flow.v_u)
        return np.asarray(speed / self.stage.gas.sound_speed(self.flow.temperature))

    @property
    def swirl(self) -> Cells:
        """`r V_u` in m2/s."""
        return np.asarray(self.passage.centre_radius * self.flow.v_u)

    @property
    def chord(self) -> Cells:
        """Place of the cells of the vanes on the chord in m, from the pivot."""
        inside, m = self.row == VANES, np.asarray(self.passage.m)
        first, last = m[:-1][inside][0], m[1:][inside][-1]
        share = (np.asarray(self.passage.centres)[inside] - first) / (last - first)
        return share * float(self.stage.nozzle.chord) - float(self.stage.nozzle.lead)

    @property
    def load(self) -> Cells:
        """Pressure difference over the vanes at those places in Pa, positive pushing inward."""
        inside, nozzle = self.row == VANES, self.stage.nozzle
        steep = np.asarray(self.flow.v_u / self.flow.v_m)[inside]
        normal = np.asarray(self.flow.blade_force)[inside] * np.sqrt(1 + steep**2) / nozzle.vanes
        return normal * np.sum(inside) / float(nozzle.chord * nozzle.height)

    @property
    def largest_load(self) -> float:
        """Pa: more than the total pressure is none that two faces can have between them."""
        return float(np.max(np.abs(self.load)))


def along_passage(stage: Stage) -> list[Along]:
    """The flow at each of the crank angles.

    **Raises:** `SimulationError` when a steady state is not found.
    """
    found, outlet = [], float(stage.outlet_pressure)
    pressure = outlet + SHARE * (HIGHEST_PRESSURE - outlet)
    for angle in CRANK_ANGLES:
        passage, flow, _ = solve_point(stage, jnp.asarray(pressure), jnp.asarray(angle))
        if not bool(flow.converged):
            raise no_steady_flow(stage, pressure, angle)
        found.append(Along(stage, pressure, angle, passage, flow))
    return found


def to_csv(passages: list[Along]) -> str:
    """One line per cell."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADS)
    for each in passages:
        flow = each.flow
        columns = (flow.m, each.passage.centre_radius, each.row, each.mach_number, flow.v_m, flow.v_u, each.swirl)
        for line in zip(*map(np.asarray, (*columns, flow.pressure, flow.temperature)), strict=True):
            writer.writerow([f"{value:.9g}" for value in (each.crank_angle, *line)])
    return text.getvalue()
