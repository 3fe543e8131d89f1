"""The engine: its cylinders and its exhaust manifold [B.2.1]."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from .._errors import InputError, is_traced, require_positive
from .._types import Scalar, Values
from ..parameters import Part, parameter
from ._gas import ExhaustGas
from ._valve import CYCLE, Valve


class Engine(Part):
    """Cylinders that fire at equal intervals, all alike, into one volume.

    `firing_order` numbers the cylinders from one. With one volume only their number counts. The clearance volume is
    not the printed one, which is the bore's area times 1 mm and would be a compression ratio of 92; it is that of an
    assumed ratio of 18. The crank radius is the printed one, with which that volume goes: 1608 cm3 in all. The engine
    that the thesis names has 1560 cm3, which is a crank radius of 44.15 mm.
    """

    place: ClassVar[str] = "engine"

    bore: Scalar = parameter(75e-3, symbol="B", unit="m", source="B.2.1", held=True)
    crank_radius: Scalar = parameter(45.5e-3, symbol="a", unit="m", source="B.2.1", held=True)
    rod: Scalar = parameter(136.5e-3, symbol="l", unit="m", source="B.2.1", held=True)
    clearance_volume: Scalar = parameter(23.6e-6, symbol="V_c", unit="m3", source="assumed", held=True)
    manifold_volume: Scalar = parameter(0.92e-3, symbol="V_x", unit="m3", source="B.2.1")
    firing_order: tuple[int, ...] = eqx.field(static=True, default=(1, 3, 4, 2))
    valve: Valve = eqx.field(default_factory=Valve)
    wall_conductance: Scalar = parameter(6.0, symbol="h A", unit="W/K", source="assumed", lower=0.0)
    wall_temperature: Scalar = parameter(700.0, symbol="T_w", unit="K", source="assumed", held=True)
    gas: ExhaustGas = eqx.field(default_factory=ExhaustGas)

    def __check_init__(self) -> None:
        if sorted(self.firing_order) != list(range(1, len(self.firing_order) + 1)) or not self.firing_order:
            raise InputError(
                f"a firing order must name each cylinder once, from 1, but it is {self.firing_order}; write e.g. "
                "(1, 3, 4, 2)"
            )
        for name in ("bore", "crank_radius", "rod"):
            require_positive(f"engine.{name}", getattr(self, name), "number of metres", "correct it")
        for name in ("clearance_volume", "manifold_volume"):
            require_positive(f"engine.{name}", getattr(self, name), "volume in m3", "correct it")
        if not is_traced(self.rod, self.crank_radius) and not bool(jnp.all(self.rod > self.crank_radius)):
            raise InputError(
                f"a connecting rod must be longer than the crank radius, but it is {self.rod} m against "
                f"{self.crank_radius} m; correct engine.rod"
            )

    @property
    def cylinders(self) -> int:
        """How many there are."""
        return len(self.firing_order)

    @property
    def interval(self) -> float:
        """deg of crank angle from one firing to the next."""
        return CYCLE / self.cylinders

    def volume(self, angle: Values) -> Values:
        """Volume in m3 of a cylinder at a crank angle in deg after its firing TDC."""
        turned = jnp.deg2rad(angle)
        arm = self.crank_radius * jnp.sin(turned)
        stroke = self.rod + self.crank_radius * (1 - jnp.cos(turned)) - jnp.sqrt(self.rod**2 - arm**2)
        return self.clearance_volume + jnp.pi / 4 * self.bore**2 * stroke
