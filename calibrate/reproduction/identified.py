"""Identified constants: what our identification recovers from our own noisy simulations of the printed actuator."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import vgtjax
from vgtjax.control import POSITION_NOISE, PRESSURE_NOISE
from vgtjax.identification import (
    Identified,
    identify_dahl,
    identify_flow_areas,
    identify_lugre,
    identify_magnetic_force,
    identify_mass_and_damping,
    identify_plunger,
    identify_spring,
)

from . import experiments, solenoid
from .rows import Found, Kind, Near, Row

RATE = 1000
"""Samples per second."""
SECONDS = 16.0
"""One length for all tests, so that one compilation serves them."""
SEED = 2012
ASTRAY = 1.2
"""What is looked for starts from this many times its printed value, so that the start is no answer."""
TOLERANCE = 0.1
"""Share of a printed value within which it counts as recovered, one for all; the thesis states no uncertainty."""
Test = Callable[[Any, Sequence[vgtjax.Trace]], Identified]


def _staircase(hold: float) -> np.ndarray:
    """A duty in percent that jumps to another level every so many seconds."""
    levels = np.random.default_rng(SEED).uniform(15.0, 100.0, round(SECONDS / hold))
    return np.repeat(levels, round(RATE * hold))


def _ramps(seconds: float, low: float = 0.0, high: float = 80.0) -> np.ndarray:
    """A duty in percent up and down again, each within so many seconds."""
    rise = np.linspace(low, high, round(RATE * seconds))
    return np.tile(np.concatenate([rise, rise[::-1]]), round(SECONDS / seconds / 2))


@functools.cache
def simulated_tests(dahl: bool = False) -> tuple[vgtjax.Trace, ...]:
    """Simulated tests of the printed actuator, with noise: quick and slow stairs, slow and quick ramps, and turns.

    Its friction is LuGre's or Dahl's.
    """
    duties = (_staircase(0.5), _staircase(2.0), _ramps(8.0), _ramps(2.0), _ramps(1.0, 40.0, 65.0))
    # A fifth of a second without duty says that the actuator starts at rest.
    return tuple(
        _sensed(printed(dahl), np.concatenate([np.zeros(RATE // 5), duty]), number)
        for number, duty in enumerate(duties)
    )


@functools.cache
def printed(dahl: bool) -> vgtjax.Actuator:
    """The printed actuator, with LuGre friction or Dahl's."""
    return vgtjax.Actuator(friction=vgtjax.Dahl()) if dahl else experiments.actuator()


def _sensed(model: vgtjax.Actuator, pwm: np.ndarray, number: int) -> vgtjax.Trace:
    time = np.arange(len(pwm)) / RATE
    reservoir = np.full_like(time, experiments.ASSUMED_RESERVOIR)
    trace = vgtjax.Trace(time=time, pwm=pwm, p_res=reservoir, name=f"test {number}")
    solution = vgtjax.simulate(model, trace)
    noise = np.random.default_rng(SEED + number).normal(size=(2, len(time)))
    return trace.replace(
        p_act=np.asarray(solution.p_act) + PRESSURE_NOISE * noise[0],
        x_d=np.asarray(solution.x_d) + POSITION_NOISE * noise[1],
    )


@dataclasses.dataclass(frozen=True)
class Identification:
    """One of our identifications, the parameters that it looks for, and whether friction under test is Dahl's."""

    test: Test
    names: tuple[str, ...]
    dahl: bool = False

    @functools.cached_property
    def found(self) -> Identified:
        """What it finds when the model has all other parameters as printed."""
        model = printed(self.dahl)
        astray = {name: ASTRAY * vgtjax.get_parameter(model, name) for name in self.names}
        return self.test(vgtjax.replace_parameters(model, astray), simulated_tests(self.dahl))


@dataclasses.dataclass(frozen=True)
class Constant:
    """A printed constant: its row, what it is called, how it is printed, and its value in `unit`.

    `name` (and `index`) is our parameter, which times `scale` is in `unit`.
    """

    id: str
    label: str
    printed: str
    value: float
    unit: str
    name: str
    scale: float = 1.0
    index: int = 0

    def row(self, section: str, where: str, identification: Identification, note: str = "") -> Row:
        """The row that compares what `identification` recovers with what was put in."""
        return Row(
            id=f"identified-{self.id}",
            kind=Kind.RECOVERY,
            section=section,
            quantity=f"{self.label}, identified",
            where=where,
            printed=self.printed,
            unit=self.unit,
            rule=Near(self.value, TOLERANCE * self.value),
            ours=lambda: self._recovered(identification.found),
            reason="What we identify from tests that we simulated with the printed value and noise; standard error "
            "{error}." + note,
            slow=True,
        )

    def _recovered(self, found: Identified) -> Found:
        value, error = (
            self.scale * float(np.ravel(part[self.name])[self.index]) for part in (found.values, found.std_errors)
        )
        digits = f"{error:.0f}" if error >= 100 else f"{error:.2g}"
        return Found(value, {"error": f"{digits} {self.unit}".strip()})


def _force_ratio() -> Found:
    """Identified magnetic force over that of (B.1) at 20, 50 and 80 % duty."""
    duty = np.array([20.0, 50.0, 80.0])
    values = np.polynomial.Polynomial(MAGNET.found.values["converter.magnetic_force"])(duty)
    return Found(tuple(float(ratio) for ratio in values / solenoid.magnetic_force(duty)))


SLOPE, SATURATION = "converter.reservoir_orifice_slope", "converter.reservoir_orifice_saturation"
ATMOSPHERE, VOLUME = "converter.atmosphere_orifice", "chamber.volume"
MEMBRANE, SPRING = "converter.membrane_stiffness", "converter.return_spring_stiffness"
DAMPING = "converter.plunger_damping"
MASS, VISCOUS = "diaphragm.mass", "friction.viscous_damping"
PRELOAD, STIFFNESS, TRAVEL = "diaphragm.preload", "diaphragm.stiffness", "diaphragm.travel"

MAGNET = Identification(identify_magnetic_force, ("converter.magnetic_force",))
PLUNGER = Identification(identify_plunger, (MEMBRANE, SPRING, DAMPING))
AREAS = Identification(identify_flow_areas, (SLOPE, SATURATION, ATMOSPHERE, VOLUME))
SPRINGS = Identification(identify_spring, (PRELOAD, STIFFNESS))
COULOMB, BRISTLES, STATIC = "friction.coulomb_force", "friction.bristle_stiffness", "friction.static_force"
BRISTLE_DAMPING, STRIBECK = "friction.bristle_damping", "friction.stribeck_velocity"
DAHL = Identification(identify_dahl, (COULOMB, BRISTLES), dahl=True)
LUGRE = Identification(identify_lugre, (STATIC, COULOMB, BRISTLES, BRISTLE_DAMPING, VISCOUS, STRIBECK))
MOTION = Identification(identify_mass_and_damping, (MASS, VISCOUS))

UNSEEN = " No sensor sees the plunger: only its mass, taken as given, tells these from steeper areas."
_PLUNGER = (
    Constant("k_mem", "k_mem", "2000 N/m", 2000.0, "N/m", MEMBRANE),
    Constant("k_s1", "k_s1", "2400 N/m", 2400.0, "N/m", SPRING),
    Constant("b_p", "b_p", "22 N s/m", 22.0, "N s/m", DAMPING),
)
_AREAS = (
    Constant("reservoir-slope", "slope of (B.2)", "0.360e-3 m", 0.360, "mm", SLOPE, 1e3),
    Constant("reservoir-saturation", "lift where (B.2) saturates", "2.5e-3 m", 2.5, "mm", SATURATION, 1e3),
    Constant("atmosphere-0", "constant of (B.3)", "2.299e-8 m2", 0.02299, "mm2", ATMOSPHERE, 1e6, 0),
    Constant("atmosphere-1", "linear coefficient of (B.3)", "1.68e-4 m", 0.168, "mm", ATMOSPHERE, 1e3, 1),
    Constant("atmosphere-2", "quadratic coefficient of (B.3)", "0.342", 0.342, "", ATMOSPHERE, 1.0, 2),
)
_VOLUME = Constant("V_0", "V_0", "60e-6 m3", 60.0, "cm3", VOLUME, 1e6)
_SPRINGS = (
    Constant("k_sm", "k_sm", "12000 N/m", 12000.0, "N/m", STIFFNESS),
    Constant("F_0", "F_0", "49.46 N", 49.46, "N", PRELOAD),
)
_TRAVEL = Constant("stroke", "stroke", "10.13 mm", 10.13, "mm", TRAVEL, 1e3)
_MOTION = (
    Constant("m_d", "m_d", "0.63 kg", 0.63, "kg", MASS),
    Constant("b_d", "b_d (with sigma_2)", "206 N s/m", 206.0, "N s/m", VISCOUS),
)
_DAHL = (
    Constant("dahl-F_c", "F_c", "2.8 N", 2.8, "N", COULOMB),
    Constant("dahl-sigma", "sigma", "42150", 42150.0, "N/m", BRISTLES),
)
_LUGRE = (
    Constant("F_s", "F_s", "3.2 N", 3.2, "N", STATIC),
    Constant("F_c", "F_c", "2.8 N", 2.8, "N", COULOMB),
    Constant("sigma_0", "sigma_0", "43135", 43135.0, "N/m", BRISTLES),
    Constant("sigma_1", "sigma_1", "429.77", 429.77, "N s/m", BRISTLE_DAMPING),
    Constant("sigma_2", "sigma_2", "206 N s/m", 206.0, "N s/m", VISCOUS),
    Constant("v_s", "v_s", "0.001 m/s", 1.0, "mm/s", STRIBECK, 1e3),
)
CONSTANTS = (*_PLUNGER, *_AREAS, _VOLUME, *_SPRINGS, _TRAVEL, *_MOTION, *_LUGRE)
"""All that are looked for one by one, but Dahl's."""

ROWS = (
    Row(
        id="identified-magnetic_force",
        kind=Kind.RECOVERY,
        section="2.2.1.1 Magnetic force identification",
        quantity="magnetic force, identified over printed, at 20, 50 and 80 % duty",
        where="(2.8), (2.9), (B.1), Figure 2.8",
        printed="1",
        unit="",
        rule=Near(1.0, 0.01),
        ours=_force_ratio,
        reason="From closed equilibria of tests that we simulated with the printed force and noise, as (2.8) says.",
        slow=True,
    ),
    *(c.row("2.2.1.2 Identification of the plunger's parameters", "Table B.1", PLUNGER, UNSEEN) for c in _PLUNGER),
    *(c.row("2.2.2.1 Effective flow area", "Figure 2.10", AREAS) for c in _AREAS),
    _VOLUME.row("2.2.3 Pneumatic actuator: chamber", "Table B.2", AREAS),
    *(c.row("2.2.3.1 Spring constant identification", "(2.36), Table B.2", SPRINGS) for c in _SPRINGS),
    *(c.row("2.2.3.2 Mass and damping constant", "(2.37), (2.38), Table B.2", MOTION) for c in _MOTION),
    *(c.row("3.3.2.2 Dahl model identification", "(3.5), Figure 3.4", DAHL) for c in _DAHL),
    *(c.row("3.3.2.4 LuGre model identification", "(3.8)-(3.12), Table B.2", LUGRE) for c in _LUGRE),
    _TRAVEL.row("3.6 Complete model validation", "section 3.6", SPRINGS),
)
