"""LuGre friction in parameters with which it can't generate energy."""

import equinox as eqx

from ..._types import Scalar, Values
from ...parameters import parameter
from .._vanes import Vanes
from ._bristles import AbstractLuGre, least_damping


class PassiveLuGre(AbstractLuGre):  # type: ignore[misc]  # mypy takes abstract variables for fields
    """[`LuGre`][] with `F_s = F_c + drop` and `sigma_2 = sigma_1 drop / F_c + excess` [3.6-3.7].

    For fits: passivity is a condition on three parameters of LuGre together, here it is two bounds at zero, which a fit
    can reach. The defaults are the printed parameters.
    """

    coulomb_force: Scalar = parameter(2.8, symbol="F_c", unit="N", source="B.2")
    stribeck_drop: Scalar = parameter(0.4, symbol="F_s-F_c", unit="N", source="B.2", lower=0.0)
    bristle_stiffness: Scalar = parameter(43135.0, symbol="sigma_0", unit="N/m", source="B.2")
    bristle_damping: Scalar = parameter(429.77, symbol="sigma_1", unit="N s/m", source="B.2")
    excess_damping: Scalar = parameter(
        206.0 - 429.77 * 0.4 / 2.8, symbol="sigma_2-b", unit="N s/m", source="B.2", lower=0.0
    )
    """Viscous damping above the bound of passivity."""
    stribeck_velocity: Scalar = parameter(1e-3, symbol="v_s", unit="m/s", source="B.2")
    stribeck_exponent: int = eqx.field(static=True, default=1)
    """As in [`LuGre`][]."""

    @property  # type: ignore[misc]  # mypy takes the abstract variable for a field
    def static_force(self) -> Values:  # type: ignore[override]
        """`F_s` in N."""
        return self.coulomb_force + self.stribeck_drop

    @property  # type: ignore[misc]
    def viscous_damping(self) -> Values:  # type: ignore[override]
        """`sigma_2` in N s/m."""
        return least_damping(self.static_force, self.coulomb_force, self.bristle_damping) + self.excess_damping

    def passivity_margin(self) -> None:
        """It can't give out energy."""

    def theta(self, vanes: Vanes) -> float:
        """One: exhaust gas has no say."""
        return 1.0
