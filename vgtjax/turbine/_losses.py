"""Losses of a row of blades [3.60-3.67], as energy-loss coefficients, whose definition [3.54] friction needs."""

import abc
import functools
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .._errors import InputError, is_traced
from .._types import Scalar, Values
from ..parameters import Part, parameter
from ._gas import Gas


class Angles(eqx.Module):
    """Of a row of blades: flow in and out, in degrees from the meridional direction, relative to the row."""

    inlet: Values
    outlet: Values


class Blading(eqx.Module):
    """Sizes of a row of blades, in m."""

    spacing: Values
    """At the trailing edge."""
    chord: Values
    height: Values
    thickness: Values
    """Largest, of a blade."""


class Range(eqx.Module):
    """What a law is known for: a value from one number to another."""

    value: Values
    low: float
    high: float
    unit: str = eqx.field(static=True)

    @property
    def kept(self) -> Bool[Array, "..."]:
        """Whether the value lies inside."""
        return jnp.asarray((self.value >= self.low) & (self.value <= self.high))


class AbstractLoss(Part):
    """How much of the kinetic energy behind a row of blades is lost in it."""

    name: ClassVar[str] = "the law"
    """For messages."""

    @abc.abstractmethod
    def coefficient(self, angles: Angles, blading: Blading, gas: Gas) -> Values:
        """Energy-loss coefficient `zeta`: loss over `W_2^2 / 2`; beyond the law's range that at its edge.

        **Raises:** as `require_valid`.
        """

    @abc.abstractmethod
    def ranges(self, angles: Angles, blading: Blading) -> dict[str, Range]:
        """What a row must keep to, by what is said of it: where the law is known, or nothing if it is to be held at the
        edges of that."""

    def valid(self, angles: Angles, blading: Blading) -> Bool[Array, "..."]:
        """Whether a row may have this law, also where it is traced; `require_valid` says why not."""
        kept = [each.kept for each in self.ranges(angles, blading).values()]
        return functools.reduce(jnp.logical_and, kept, jnp.asarray(True))

    def require_valid(self, angles: Angles, blading: Blading, row: str = "the row") -> None:
        """**Raises:** `InputError` for a row beyond the law's range, unless it is to be held at its edge; says nothing
        of one that is traced."""
        for what, each in self.ranges(angles, blading).items():
            if not is_traced(each.value) and not np.all(each.kept):
                raise InputError(
                    f"{what} of {row} must be from {each.low:g} to {each.high:g}{each.unit} for {self.name}, but it is "
                    f"{float(np.ravel(each.value)[0]):.3g}; take other blades, hold the law at its edges (hold=True), "
                    "or give the loss",
                    "losses",
                )


class GivenLoss(AbstractLoss):
    """A coefficient that is given, whatever the blades."""

    zeta: Scalar = parameter(0.08, symbol="zeta", unit="-", source="assumed", held=True)

    def coefficient(self, angles: Angles, blading: Blading, gas: Gas) -> Values:
        """As it is given."""
        return self.zeta

    def ranges(self, angles: Angles, blading: Blading) -> dict[str, Range]:
        """It is known everywhere."""
        return {}


class Soderberg(AbstractLoss):
    """Soderberg's correlation: `base + rise (deflection / 100 deg)^2` (Horlock 1966), for deflections of up to 120 deg.

    It has neither Mach number nor clearance in it.
    """

    base: Scalar = parameter(0.04, symbol="zeta_0", unit="-", source="Soderberg", held=True)
    rise: Scalar = parameter(0.06, symbol="zeta_1", unit="-", source="Soderberg", held=True)
    hold: bool = eqx.field(static=True, default=False)
    """Whether a row beyond the correlation has the loss at its edge; else it is refused."""
    name = "Soderberg's correlation"
    LARGEST: ClassVar[float] = 120.0

    def coefficient(self, angles: Angles, blading: Blading, gas: Gas) -> Values:
        """From the deflection; see the base class."""
        self.require_valid(angles, blading)
        deflection = jnp.abs(angles.outlet - angles.inlet)
        return self.base + self.rise * (jnp.minimum(deflection, self.LARGEST) / 100) ** 2

    def ranges(self, angles: Angles, blading: Blading) -> dict[str, Range]:
        """Of the deflection."""
        if self.hold:
            return {}
        return {"the deflection": Range(jnp.abs(angles.outlet - angles.inlet), 0.0, self.LARGEST, " deg")}


class AinleyMathieson(AbstractLoss):
    """Ainley and Mathieson's profile loss with its correction for thickness [3.60, 3.63], losses of walls and clearance
    [3.64-3.67].

    The two methods that the thesis prints are this one twice (erratum E15). Curves are Aungier's fits (2006); where the
    print needs a curve that it does not show, and for the clearance, whose printed form has a unit (E16), Dunham and
    Came's forms (1970) stand. For axial cascades: of a radial nozzle this is a first guess, and a fit moves a
    [`GivenLoss`][]. Pivoted vanes behind a volute, which gas meets and leaves with swirl of one sign, lie outside of it
    at every angle: `-beta_1 / alpha_2` of the default ones is -0.89 to -0.71, so that their profile loss is that of a
    nozzle row.
    """

    clearance: Scalar = parameter(
        0.0, symbol="k", unit="m", source="3.61, assumed", positive=False, lower=0.0, held=True
    )
    """Between blade and wall."""
    mach_number: Scalar = parameter(0.7, symbol="M_2", unit="-", source="assumed", held=True)
    """Behind the row, at which its loss of pressure is one of energy [E13]."""
    hold: bool = eqx.field(static=True, default=False)
    """Whether a row beyond the correlation has the loss at its edge; else it is refused. An outlet angle is held in all
    losses, the rest in that of the profile, which alone has it from charts."""
    name = "Ainley and Mathieson's correlation"
    RATIO: ClassVar[tuple[float, float]] = (0.0, 1.0)
    """`-beta_1 / alpha_2`, from a nozzle row to an impulse row: the profile loss lies between those of both [3.60]."""
    OUTLET: ClassVar[tuple[float, float]] = (40.0, 80.0)
    """deg"""
    PITCH: ClassVar[tuple[float, float]] = (0.3, 1.1)
    """Over chord, as far as their charts go."""
    THICKNESS: ClassVar[tuple[float, float]] = (0.15, 0.25)
    """Over chord."""

    def coefficient(self, angles: Angles, blading: Blading, gas: Gas) -> Values:
        """From the row's angles and sizes; see the base class."""
        self.require_valid(angles, blading)
        side = jnp.where(angles.outlet < 0, -1.0, 1.0)
        held = Angles(angles.inlet, side * jnp.clip(jnp.abs(angles.outlet), *self.OUTLET))
        lost = self.profile(held, blading) + self.secondary(held, blading) + self.tip(held, blading)
        return energy_loss(lost, self.mach_number, gas)

    def ranges(self, angles: Angles, blading: Blading) -> dict[str, Range]:
        """Of the outlet angle, the ratio of angles, the pitch and the thickness."""
        if self.hold:
            return {}
        return {
            "the outlet angle": Range(jnp.abs(angles.outlet), *self.OUTLET, " deg"),
            "minus inlet over outlet angle": Range(self.ratio(angles), *self.RATIO, ""),
            "pitch over chord": Range(blading.spacing / blading.chord, *self.PITCH, ""),
            "thickness over chord": Range(blading.thickness / blading.chord, *self.THICKNESS, ""),
        }

    def ratio(self, angles: Angles) -> Values:
        """`-beta_1 / alpha_2`, with the outlet angle in its range: positive where a row turns gas past the meridian."""
        return -angles.inlet * jnp.sign(angles.outlet) / jnp.clip(jnp.abs(angles.outlet), *self.OUTLET)

    def profile(self, angles: Angles, blading: Blading) -> Values:
        """Loss of total pressure over dynamic pressure in the profile [3.60, corrected].

        Between a nozzle row, `beta_1 = 0`, and an impulse row, `beta_1 = -alpha_2`, by the square of their ratio;
        blades thicker than a fifth of the chord lose more, by that ratio's power. What is beyond a range is held at its
        edge.
        """
        ratio = jnp.clip(self.ratio(angles), *self.RATIO)
        b = 90 - jnp.clip(jnp.abs(angles.outlet), *self.OUTLET)
        pitch = jnp.clip(blading.spacing / blading.chord, *self.PITCH)
        nozzle, impulse = _nozzle_row(pitch, b), _impulse_row(pitch, b)
        thickness = jnp.clip(blading.thickness / blading.chord, *self.THICKNESS)
        return (nozzle + ratio**2 * (impulse - nozzle)) * (thickness / 0.2) ** ratio

    def secondary(self, angles: Angles, blading: Blading) -> Values:
        """Of the walls: Dunham and Came's `0.0334 (c/h) cos a_2 / cos b_1 Z`; the curve of [3.65] is not printed."""
        turned = jnp.cos(jnp.radians(angles.outlet)) / jnp.cos(jnp.radians(angles.inlet))
        return 0.0334 * blading.chord / blading.height * turned * _loading(angles)

    def tip(self, angles: Angles, blading: Blading) -> Values:
        """Of the clearance: `0.47 (c/h) (k/c)^0.78 Z` (Dunham and Came)."""
        gap = self.clearance / blading.chord
        grown = jnp.where(gap > 0, jnp.where(gap > 0, gap, 1.0) ** 0.78, 0.0)
        return 0.47 * blading.chord / blading.height * grown * _loading(angles)


def energy_loss(pressure_loss: Values, mach_number: Values, gas: Gas) -> Values:
    """Energy-loss coefficient of a loss `Y = (p_01 - p_02) / (p_02 - p_2)` at a Mach number behind the row [E13].

    Of all orders: entropy rises by `r ln(1 + Y (1 - p_2 / p_02))`. At rest it is `Y`.
    """
    squared = jnp.maximum(mach_number, 1e-3) ** 2
    expanded = (1 + 0.5 * (gas.gamma - 1) * squared) ** (-gas.gamma / (gas.gamma - 1))
    return 2 * jnp.log1p(pressure_loss * (1 - expanded)) / (gas.gamma * squared)


def _loading(angles: Angles) -> Values:
    """Ainley and Mathieson's `Z = (C_L / (s/c))^2 cos^2 a_2 / cos^3 a_m` [3.67]."""
    inlet, outlet = jnp.radians(angles.inlet), jnp.radians(angles.outlet)
    mean = jnp.arctan(0.5 * (jnp.tan(inlet) + jnp.tan(outlet)))
    lift = 2 * (jnp.tan(inlet) - jnp.tan(outlet)) * jnp.cos(mean)
    return lift**2 * jnp.cos(outlet) ** 2 / jnp.cos(mean) ** 3


def _nozzle_row(pitch: Values, b: Values) -> Values:
    least = jnp.where(b < 30, 0.46 + b / 77, 0.614 + b / 130)
    first = jnp.where(b < 27, 0.025 + (27 - b) / 530, 0.025 + (27 - b) / 3085)
    off = pitch - least
    high = 0.1583 - b / 1640
    steep = 0.08 * ((b / 30) ** 2 - 1)
    size = jnp.sqrt(off**2 + 1e-12)
    return first + jnp.where(b < 30, high * off**2 + steep * off**3, high * size ** (1 + b / 30))


def _impulse_row(pitch: Values, b: Values) -> Values:
    least = 0.224 + 1.575 * b / 90 - (b / 90) ** 2
    first = 0.242 - b / 151 + (b / 127) ** 2
    high = jnp.where(b < 30, 0.3 + (30 - b) / 50, 0.3 + (30 - b) / 275)
    steep = 0.88 - b / 42.4 + (b / 72.8) ** 2
    off = pitch - least
    return first + high * off**2 - steep * off**3
