"""Where a table of flow has its knots: at every kink of the flow, and denser where it bends."""

import numpy as np
from jaxtyping import Float

from ...parts import Air, Converter

OPENING = 8
"""Knots over the parabola of the atmosphere's orifice [B.3], in squared distances."""
CURVED = 5
"""Knots from the choked flow to equal pressures, in squared distances towards the latter, where the root is steep."""


def lift_knots(converter: Converter, lowest: float, highest: float) -> Float[np.ndarray, " positions"]:
    """Plunger positions in m between two ends: saturation, closed, the opened leak, and the parabola."""
    saturated = -float(converter.reservoir_orifice_saturation)
    leak = float(converter.opening_lift)
    above = max(highest, 2 * leak)
    rise = leak + (above - leak) * (np.arange(1, OPENING + 1) / OPENING) ** 2
    below = [min(lowest, 1.001 * saturated), saturated]
    return np.unique(np.concatenate([below, [0.0, leak], rise]))


def pressure_knots(air: Air, reservoir: float) -> Float[np.ndarray, " pressures"]:
    """Pressures in Pa from half the reservoir's to a twentieth above the atmosphere's.

    Below the reservoir's and above the atmosphere's, flow goes the other way.
    """
    ambient, critical = float(air.pressure), float(air.critical_ratio())
    towards = np.linspace(0.0, 1.0, CURVED + 1) ** 2
    evacuated = reservoir + (reservoir / critical - reservoir) * towards
    vented = ambient - ambient * (1 - critical) * towards
    return np.unique(np.concatenate([[0.5 * reservoir], evacuated, vented, [1.05 * ambient]]))
