"""LuGre friction in the thesis's parameters [3.6-3.7]."""

import warnings

import equinox as eqx
import numpy as np

from ..._errors import is_traced
from ..._types import Values
from .._vanes import Vanes
from ._bristles import AbstractLuGre, AbstractPrintedLuGre


class PassivityWarning(UserWarning):
    """Friction with these parameters can generate energy."""


class LuGre(AbstractPrintedLuGre):
    """`z' = v - sigma_0 |v| z / g(v)`, `F_f = sigma_0 z + sigma_1 z' + sigma_2 v` [3.6].

    Parameters with which it can generate energy are legal, but constructing it with them gives a
    [`PassivityWarning`][], see `passivity_bound`.
    """

    stribeck_exponent: int = eqx.field(static=True, default=1)
    """Power of `|v| / v_s` in the Stribeck curve: 1 as in [3.7], or 2 as in [5.62]."""

    def __check_init__(self) -> None:
        warn_unless_passive(self)

    def passivity_margin(self) -> Values:
        """`sigma_2` beyond its bound."""
        return self.spare_damping()

    def theta(self, vanes: Vanes) -> float:
        """One: exhaust gas has no say."""
        return 1.0


def warn_unless_passive(friction: AbstractLuGre) -> None:
    """Warns of friction that can generate energy; says nothing while its parameters are traced."""
    if is_traced(friction) or friction.is_passive:
        return
    spare, viscous = np.broadcast_arrays(friction.spare_damping(), friction.viscous_damping)
    worst = np.argmin(spare)
    warnings.warn(
        f"friction.viscous_damping must be at least {(viscous - spare).flat[worst]:.6g} N s/m for passive LuGre "
        f"friction, but it is {viscous.flat[worst]:.6g} and may generate energy; raise it, lower bristle_damping, or "
        "use PassiveLuGre",
        PassivityWarning,
        stacklevel=4,
    )
