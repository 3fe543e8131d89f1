"""One controller on plants that it does not know: position alone, the printed design model, gas on the vanes."""

import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import vgtjax
from vgtjax import control
from vgtjax.control import (
    AbstractController,
    AbstractSignal,
    ClosedLoop,
    LateDuty,
    Scenario,
    Sensors,
    Sine,
)
from vgtjax.parts import OPERATING_POINTS, SpeedMap
from vgtjax.plants import assemble
from vgtjax.population import Spread, make_sample, spread_population

from ..table import Section

T = TypeVar("T")
PLANTS = 100
LANES = 25
SEED = 1863
"""Of plants that no controller or default was tried on while it was made."""
NOISE_SEED = 18
SETTLED = 2.0
"""s from the start, after which errors along Signal 1 count."""
PERIOD = 2 * np.pi / 0.125
"""s; of Signal 1 [5.44]."""
STEP, LEVEL = 3.0, 0.008
"""s and m; Signal 2 [5.45]."""
ANSWER = 0.5
"""s from the step."""
RISE, JUMP = 0.5, 1e-4
"""s that the step of Signal 2 takes: one that a rod can follow, and less than a sample, as [5.45] prints it."""
LATE = 4e-3
"""s"""
PULSATION = 0.2
"""Of the turbine pressure, to either side."""
GAS = (2.6, 1.6)
"""N/bar; force on closing and opening vanes at the closed stop."""
SIDE_SPEED = 1e-4
"""m/s, over which the vane force changes sides."""
HALF_WIDTHS = {
    "converter.membrane_stiffness": 0.14,
    "converter.return_spring_stiffness": 0.14,
    "converter.plunger_damping": 0.17,
    "converter.reservoir_orifice_slope": 0.14,
    "converter.reservoir_orifice_saturation": 0.07,
    "converter.atmosphere_orifice[0]": 0.17,
    "converter.atmosphere_orifice[1]": 0.17,
    "converter.atmosphere_orifice[2]": 0.17,
    "diaphragm.mass": 0.10,
    "diaphragm.preload": 0.10,
    "diaphragm.stiffness": 0.085,
    "diaphragm.travel": 0.017,
    "chamber.volume": 0.085,
    "friction.static_force": 0.20,
    "friction.coulomb_force": 0.20,
    "friction.bristle_stiffness": 0.26,
    "friction.bristle_damping": 0.26,
    "friction.viscous_damping": 0.20,
    "friction.stribeck_velocity": 0.34,
}
"""Of uniform distributions, as parts of the nominal value."""
MAGNET = (0.04, 0.03)
"""Half widths of the magnetic force's size and of the duty's."""


class Surroundings(eqx.Module):
    """What is around each of several plants."""

    noise: Float[Array, " plants"]
    """Standard deviation of a sample of its position sensor in m."""
    delay: Float[Array, " plants"]
    """s by which the duty arrives late."""

    @classmethod
    def alike(cls, count: int, delay: float = 0.0) -> "Surroundings":
        """Those of a bench around so many plants."""
        return cls(jnp.full(count, Sensors.bench().position.noise), jnp.full(count, delay))


@dataclasses.dataclass(frozen=True)
class Course:
    """A reference in seconds, a pressure in Pa gauge that pulsates or does not, and a duty that arrives late or not."""

    name: str
    pressure: float
    frequency: float = 0.0
    late: bool = False
    rise: float = RISE
    """s that Signal 2 takes for its step; below the sampling time it jumps, as printed."""

    @property
    def turbine(self) -> AbstractSignal:
        """Pa gauge; a sine in any case, so that one program serves all."""
        amplitude = PULSATION * self.pressure if self.frequency else 0.0
        return Sine(amplitude, 2 * np.pi * self.frequency, self.pressure)

    @property
    def delay(self) -> float:
        """Of the duty in s."""
        return LATE if self.late else 0.0

    def __str__(self) -> str:
        shaken = f", {PULSATION:.0%} at {self.frequency:g} Hz" if self.frequency else ""
        late = f", {1e3 * LATE:g} ms late" if self.late else ""
        return f"{self.name}{', a jump' if self.rise == JUMP else ''}, {self.pressure / 100:g} mbar{shaken}{late}"


COURSES = (
    *(Course("Signal 1", pressure) for pressure in OPERATING_POINTS),
    *(Course("Signal 1", 3e5, frequency) for frequency in (33.0, 67.0)),
    *(Course("Signal 1", pressure, late=True) for pressure in (0.0, 3e5)),
    Course("Signal 1", 3e5, 33.0, late=True),
    *(Course("Signal 2", pressure) for pressure in OPERATING_POINTS),
    *(Course("Signal 2", 3e5, frequency) for frequency in (33.0, 67.0)),
    *(Course("Signal 2", pressure, late=True) for pressure in (0.0, 3e5)),
    *(Course("Signal 2", pressure, rise=JUMP) for pressure in (0.0, 3e5)),
    Course("Signal 2", 3e5, late=True, rise=JUMP),
)


class Errors(eqx.Module):
    """Of the closed loops of one course, one for each plant."""

    rms: Float[Array | np.ndarray, " plants"]
    peak: Float[Array | np.ndarray, " plants"]
    """m, of the position after it has settled."""
    overshoot: Float[Array | np.ndarray, " plants"]
    """m above the last value of the reference."""
    pressure: Float[Array | np.ndarray, " plants"]
    """Root mean square error of the observed pressure in Pa; NaN for a controller that observes none."""
    chatter: Float[Array | np.ndarray, " plants"]
    """% of duty."""


def measure() -> Section:
    """Puts one controller on many plants."""
    section = Section(
        "One controller on plants that it does not know",
        "`LoadBackstepping` on the printed design model, with default gains, measures the position with 8 um of noise, "
        f"and nothing else. {PLANTS} plants around the printed actuator, with a vane force. From rest; errors count "
        f"from {SETTLED:g} s on, those of Signal 2 from {ANSWER:g} s after the step on. "
        f"Its step takes {RISE:g} s, or is the jump that is printed.",
        ("course", "RMS error", "worst", "peak", "overshoot", "observed pressure", "95 %", "duty's chatter"),
    )
    controller = control.LoadBackstepping.for_plant(vgtjax.Actuator())
    plants = draw(PLANTS)
    for course in COURSES:
        around = Surroundings.alike(PLANTS, course.delay)
        section.add(str(course), *cells(course, follow(controller, plants, around, course)))
    section.notes.append("RMS error, observed pressure (RMS) and chatter are those of the middle plant.")
    return section


def cells(course: Course, errors: Errors) -> tuple[str, ...]:
    """RMS error of the middle plant and of the worst, peak, overshoot, observed pressure and chatter."""
    rms, pressure = np.median(errors.rms), np.median(errors.pressure)
    above = f"{1e6 * errors.overshoot.max():.0f} um" if course.name == "Signal 2" else ""
    return (
        f"{1e6 * rms:.1f} um",
        f"{1e6 * errors.rms.max():.1f} um",
        f"{1e6 * errors.peak.max():.0f} um",
        above,
        f"{pressure:.0f} Pa",
        f"{np.quantile(errors.pressure, 0.95):.0f} Pa",
        f"{np.median(errors.chatter):.2f} %",
    )


def draw(count: int, seed: int = SEED, widths: Mapping[str, float] = HALF_WIDTHS) -> vgtjax.Actuator:
    """Plants around the printed actuator with a vane force, one behind the other in every array."""
    nominal = assemble(vgtjax.Actuator(), vane_force=_vane_force())
    spreads = {name: Spread("uniform", relative=width) for name, width in widths.items()}
    sides = {f"vane_force.{side}": Spread("lognormal", relative=0.12) for side in ("closing", "opening")}
    population = spread_population(nominal, spreads=spreads | sides, vary=[])
    points = make_sample(population.dimensions + 2, count, "latin-hypercube", seed).points(0, count)
    rows = jnp.asarray(population.values(points[:, :-2]))
    magnets = jnp.asarray(1 + (2 * points[:, -2:] - 1) * np.array(MAGNET))

    def one(row: Array, magnet: Array) -> vgtjax.Actuator:
        plant = population.factors.unpack(nominal, row)
        size, bend = magnet
        force = vgtjax.get_parameter(plant, "converter.magnetic_force") * size * bend ** jnp.arange(5)
        return eqx.tree_at(lambda p: p.converter.magnetic_force.coefficients, plant, force)

    return jax.vmap(one)(rows, magnets)


def _vane_force() -> SpeedMap:
    """That of the examples: it falls with the opening of the vanes, and differs from side to side."""
    empty = SpeedMap(side_speed=SIDE_SPEED)
    pressure, angle = np.meshgrid(empty.turbine_pressure, empty.crank_angle, indexing="ij")
    shape = (pressure / 1e5 * (0.35 + 0.65 * np.exp(-angle / 12))).ravel()
    closing, opening = GAS
    return dataclasses.replace(empty, closing=jnp.asarray(closing * shape), opening=jnp.asarray(-opening * shape))


def follow(
    controller: AbstractController, plants: vgtjax.Actuator, around: Surroundings, course: Course, seconds: float = 0.0
) -> Errors:
    """Closed loops of all plants along a course; for so many seconds, or a whole period and the time after a step."""
    stepping = course.name == "Signal 2"
    signal = control.signal_2(course.rise) if stepping else control.signal_1()
    settled, end = (STEP + ANSWER, STEP + 2.0) if stepping else (SETTLED, SETTLED + PERIOD)
    count = len(around.noise)
    keys = jax.random.split(jax.random.key(NOISE_SEED), count)

    chunks = [slice(begin, begin + LANES) for begin in range(0, count, LANES)]
    parts = [
        _run(controller, *plants_at((plants, around, keys), chunk), (signal, course.turbine), seconds or end, settled)
        for chunk in chunks
    ]
    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)


def plants_at(plants: T, places: slice) -> T:
    """Some of the plants, or what is around them."""
    return jax.tree.map(lambda leaf: leaf[places], plants)


@eqx.filter_jit
def _run(
    controller: AbstractController,
    plants: vgtjax.Actuator,
    around: Surroundings,
    keys: Array,
    signals: tuple[AbstractSignal, AbstractSignal],
    duration: float,
    settled: float,
) -> Errors:
    """One program for all controllers of a class and all courses as long: reference and turbine pressure are given."""

    def one(plant: vgtjax.Actuator, own: Surroundings, key: Array) -> Errors:
        return _errors(controller, plant, _scenario(signals, own, key), duration, settled)

    return jax.vmap(one)(plants, around, keys)


def _scenario(signals: tuple[AbstractSignal, AbstractSignal], own: Surroundings, key: Array) -> Scenario:
    sensors = eqx.tree_at(lambda s: s.position.noise, Sensors.bench(), own.noise)
    reference, turbine = signals
    return Scenario(reference, turbine, sensors=sensors, key=key, disturbances=(LateDuty(own.delay),))


def _errors(
    controller: AbstractController, plant: vgtjax.Actuator, scenario: Scenario, duration: float, settled: float
) -> Errors:
    run: ClosedLoop = control.close_loop(plant, controller, scenario, duration, throw=False)
    return Errors(
        control.tracking_rms(run, settled),
        control.tracking_peak(run, settled),
        jnp.max(run.position - run.reference.position[-1]),
        control.pressure_rms(run, settled),
        control.chatter(run, settled),
    )
