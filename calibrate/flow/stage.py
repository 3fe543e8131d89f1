"""A turbine with its linkage: what a map of flow and force depends on."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from vgtjax import InputError
from vgtjax.parts import Crank
from vgtjax.turbine import Gas, Inlet, Nozzle, Passage

RATIO = 48 / 31.6
"""Degrees of the vanes a degree of the crank: the print's own figures disagree (erratum E21)."""
CRANK_RANGE = (4.0, 37.0)
"""deg of the crank."""
CLOSED = 4.0
"""deg of vanes and of the crank, with the rod at its stop."""


class Stage(eqx.Module):
    """The nozzle and what gas flows through it; sizes and states are assumed."""

    nozzle: Nozzle = eqx.field(default_factory=Nozzle)
    crank: Crank = eqx.field(default_factory=Crank)
    gas: Gas = eqx.field(default_factory=Gas)
    total_temperature: float = 900.0
    """K before the turbine."""
    outlet_pressure: float = 1.05e5
    """Pa absolute behind it."""
    speed_ratio: float = 0.6
    """Speed of the wheel's blades over the spouting velocity."""

    def vane_angle(self, crank_angle: Any) -> Any:
        """Of the vanes from the tangent, in rad, at a crank angle in deg."""
        return jnp.radians(CLOSED + RATIO * (crank_angle - CLOSED))

    def wheel_speed(self, total_pressure: Any) -> Any:
        """In rad/s at a total pressure in Pa absolute."""
        expanded = self.gas.expanded_temperature(1.0, self.outlet_pressure / total_pressure)
        falling = 2 * self.gas.heat_capacity * self.total_temperature * (1 - expanded)
        return self.speed_ratio * jnp.sqrt(jnp.maximum(falling, 1e-6)) / self.nozzle.rotor.inlet_radius

    def force(self, moment: Any) -> Any:
        """At the rod in N against closing, of a moment on each vane in N m, by virtual work [3.72, corrected]."""
        return self.nozzle.vanes * moment * jnp.radians(RATIO * self.crank.ratio)

    def passage(self, total_pressure: Any, crank_angle: Any, cells: int = 224) -> tuple[Passage, Inlet]:
        """What the gas flows through at Pa absolute and deg, and what it comes from."""
        passage = self.nozzle.passage(self.vane_angle(crank_angle), self.wheel_speed(total_pressure), cells, self.gas)
        return passage, self.nozzle.inlet(total_pressure, self.total_temperature)

    def require_range(self) -> None:
        """**Raises:** `InputError` for a geometry that does not work at some angle of the crank."""
        for crank_angle in np.linspace(*CRANK_RANGE, 12):
            self.nozzle.require_range(self.vane_angle(crank_angle))


def stage_of(study: Any) -> Stage:
    """The stage of a study.

    **Raises:** `InputError` when its vane force is no turbine.
    """
    raise InputError(
        f"flow needs vane_force = 'turbine', but it is '{study.components.vane_force}'; change it under [components], "
        "or leave the study out"
    )
