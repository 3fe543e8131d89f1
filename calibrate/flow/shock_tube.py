"""The exact solution of a shock tube, to judge what the flow solver makes of it."""

import numpy as np
import scipy
from jaxtyping import Float

GAMMA = 1.4
LEFT, RIGHT = (1.0, 1e5), (0.125, 1e4)
"""Density in kg/m3 and pressure in Pa on both sides of the diaphragm (Sod 1978)."""

Along = Float[np.ndarray, " position"]


def exact(position: Along, time: float) -> tuple[Along, Along]:
    """Density in kg/m3 and pressure in Pa at positions from the diaphragm in m, a time in s after it broke."""
    (rho_l, p_l), (rho_r, p_r) = LEFT, RIGHT
    sound_l, share = np.sqrt(GAMMA * p_l / rho_l), (GAMMA - 1) / (GAMMA + 1)

    def shocked(p: float) -> float:
        return float((p - p_r) * np.sqrt(2 / ((GAMMA + 1) * rho_r) / (p + share * p_r)))

    def expanded(p: float) -> float:
        return float(2 * sound_l / (GAMMA - 1) * (1 - (p / p_l) ** ((GAMMA - 1) / (2 * GAMMA))))

    between = scipy.optimize.brentq(lambda p: shocked(p) - expanded(p), 1.01 * p_r, p_l)
    velocity = shocked(between)
    behind_fan = rho_l * (between / p_l) ** (1 / GAMMA)
    behind_shock = rho_r * (between / p_r + share) / (share * between / p_r + 1)
    tail = velocity - np.sqrt(GAMMA * between / behind_fan)
    along = position / time
    sound = (2 / (GAMMA + 1) * sound_l - share * along) / sound_l
    shock = velocity * behind_shock / (behind_shock - rho_r)
    regions = [along < -sound_l, along < tail, along < velocity, along < shock]
    density = [rho_l, rho_l * sound ** (2 / (GAMMA - 1)), behind_fan, behind_shock]
    pressure = [p_l, p_l * sound ** (2 * GAMMA / (GAMMA - 1)), between, between]
    return np.select(regions, density, rho_r), np.select(regions, pressure, p_r)
