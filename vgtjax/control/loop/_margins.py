"""How far a linear loop is from its limit of stability."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy
from jaxtyping import Complex, Float

from ._linear_loop import LinearLoop

LOWEST = 1e-5
"""Of the sampling rate: where the frequencies begin."""
FREQUENCIES = 400
"""To half the sampling rate, evenly in their logarithm; crossings between them are found by Brent's method."""
AXIS = 1e-2
"""Of its size, an imaginary part that is none."""
STANDING = 1e-9
"""By which an eigenvalue may exceed one: those of what is learned and does not die away are one, but for rounding."""


@dataclasses.dataclass(frozen=True)
class Margins:
    """What a loop bears at its cut, each with all else as it is; NaN of a loop that is not stable.

    `gain` is the least factor of the loop's gain that makes it unstable, infinite if none does; `reduction` is the
    largest factor below one that does, 0 if none; `phase` is the least lag or lead in degrees; `delay` in s is the
    least additional delay; `sensitivity` is the largest `1 / |1 + L|`, the inverse of the distance of `L` to -1.
    `crossover` in rad/s is the highest frequency at which `|L|` is one, zero without one. `radius` is that of the
    closed loop's eigenvalues, `stable` whether none is above one.
    """

    gain: float
    reduction: float
    phase: float
    delay: float
    sensitivity: float
    crossover: float
    radius: float

    @property
    def stable(self) -> bool:
        """Whether the closed loop is."""
        return self.radius < 1 + STANDING


def margins(loop: LinearLoop) -> Margins:
    """Margins of a linear loop by its frequency response, up to half the sampling rate.

    Gain margins are those of crossings of the negative real axis, phase and delay margins those of the unit circle.
    """
    radius = loop.spectral_radius
    if not radius < 1 + STANDING:
        none = math.nan
        return Margins(none, none, none, none, none, none, radius)
    rates = np.geomspace(LOWEST, 0.5, FREQUENCIES) * 2 * np.pi / loop.period
    response = loop.return_ratio(rates)
    # Both ends lie on the real axis, where no sign need change; but for loops that integrate at the first one.
    ends = rates[[0, -1]][np.abs(response.imag[[0, -1]]) < AXIS * np.abs(response[[0, -1]])]
    real = np.append(_crossings(loop, rates, response, np.imag), ends)
    turned = loop.return_ratio(real).real
    factors = -1 / turned[turned < 0]
    unit = _crossings(loop, rates, response, _log_size)
    leads = np.angle(-loop.return_ratio(unit))
    return Margins(
        gain=float(np.min(factors[factors > 1], initial=math.inf)),
        reduction=float(np.max(factors[factors < 1], initial=0.0)),
        phase=float(np.degrees(np.min(np.abs(leads), initial=math.pi))),
        delay=float(np.min(np.mod(leads, 2 * np.pi) / unit, initial=math.inf)),
        sensitivity=float(1 / np.min(np.abs(1 + response))),
        crossover=float(np.max(unit, initial=0.0)),
        radius=radius,
    )


def _crossings(
    loop: LinearLoop,
    rates: Float[np.ndarray, " rates"],
    response: Complex[np.ndarray, " rates"],
    measure: Callable[[Complex[np.ndarray, "..."]], Float[np.ndarray, "..."]],
) -> Float[np.ndarray, " crossings"]:
    """Rates at which a measure of the response passes zero."""
    signs = np.sign(measure(response))
    found = [
        scipy.optimize.brentq(lambda rate: float(measure(loop.return_ratio(np.array([rate])))[0]), *rates[i : i + 2])
        for i in np.flatnonzero(signs[:-1] * signs[1:] < 0)
    ]
    return np.array(found)


def _log_size(response: Complex[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    with np.errstate(divide="ignore"):  # a loop that does not answer at all is below every limit
        return np.log(np.abs(response))
