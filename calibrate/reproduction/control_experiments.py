"""Closed loops on the full plant at three turbine pressures; each is run once.

Plant, references, sensors and gains are ours: the thesis prints the knocker's gains and Signals 1 and 2 only. Sensors
have noise and steps as [`control.Sensors.bench`][] assumes them, and no offset. Each controller has one set of gains
for all pressures.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import vgtjax
from vgtjax import control
from vgtjax.control import AbstractController, AbstractSignal, Scenario
from vgtjax.parts import OPERATING_POINTS
from vgtjax.plants import assemble

from ..population.actuators import read_actuators
from ..population.job import FLEET
from ..study.read import load_study
from . import experiments, loops

SETTLED = 2.0
"""s from the start, after which errors count."""
EXPONENT = 1.3
"""Of the air in the observer's model: 1 keeps its temperature as [5.4], 1.4 all of its heat as the plant, whose
temperature then moves away from the atmosphere's."""
SEED = 5
DUTY_BEFORE = 51.0
"""%; about what holds the rod at 4 mm."""
JUMP = 1e-4
"""s; less than a sample, so that no sample sees Signal 2 between its levels, nor a derivative of it."""
FRICTIONLESS = 0.02
"""N; so little that a swing is not friction's."""
PRINTED_PULSE, STRONG_PULSE = 2.0, 4.0
"""%; amplitude of the knocker's pulses in section 5.3.1, and one that ends the swing into which the PI falls at the
beginning within `SETTLED`."""


@dataclasses.dataclass(frozen=True)
class Course:
    """A reference with its start, and for how many seconds it is followed."""

    signal: Callable[[], AbstractSignal]
    duration: float
    start: float | None = None
    """Position in m where the rod is balanced at first; `None` is at rest with the chamber at atmosphere."""

    def scenario(self, pressure: Float[Array, ""], key: Array) -> Scenario:
        """At a turbine pressure in Pa gauge, with the noise of a seed."""
        begin: dict[str, Any] = {}
        if self.start is not None:
            begin = {"start": control.balanced_at(self.start), "duty_before": DUTY_BEFORE}
        turbine, sensors = control.Constant(pressure), control.Sensors.bench()
        return Scenario(self.signal(), turbine, sensors=sensors, key=key, **begin)


SLOW = (np.array([0.1, 0.11, 20.11]), np.array([0.004, 0.005, 0.0058]))
"""s and m; corners of the slow reference."""
COURSES = {
    "slow": Course(lambda: control.Ramps(*SLOW, rounding=0.01), 20.0, 0.004),
    "Signal 1": Course(control.signal_1, SETTLED + control.SIGNAL_1_PERIOD),
    "Signal 2": Course(lambda: control.signal_2(rise=JUMP), 8.0),
}
"""The slow one goes a millimetre at once and then 0.04 mm/s; that of the thesis is a picture. Signal 2 jumps [5.45]."""


@functools.cache
def plant() -> vgtjax.Actuator:
    """The printed actuator with a borrowed vane force."""
    return assemble(experiments.actuator(), vane_force=loops.borrowed_map())


def _pi() -> control.PI:
    return control.PI(proportional_gain=250.0, integral_gain=220_000.0, base=control.StaticBalance())


def _backstepping(believed: vgtjax.Actuator) -> control.Backstepping:
    return control.Backstepping.for_plant(believed, control.DesignModel.for_plant(believed, exponent=EXPONENT))


CONTROLLERS: dict[str, Callable[[], AbstractController]] = {
    "PI": _pi,
    "PI and knocker": lambda: control.Knocker(_pi(), amplitude=PRINTED_PULSE),
    "PI and strong knocker": lambda: control.Knocker(_pi(), amplitude=STRONG_PULSE),
    "friction observer": lambda: control.FrictionCompensation(vane_force=plant().vane_force),
    "backstepping": lambda: _backstepping(plant()),
    "backstepping, printed": lambda: _backstepping(experiments.actuator()),
    "adaptive backstepping": control.AdaptiveBackstepping,
    "load learned": lambda: control.LoadBackstepping.for_plant(experiments.actuator()),
}
"""What each knows: the PI the printed actuator's static balance; friction observer and backstepping the plant exactly,
its vane force and the turbine pressure, and they measure the position, unless they are told the printed actuator alone;
the adaptive controller that, and it measures position and chamber pressure; the one that learns the load that too, and
it measures the position alone. The others measure the reservoir's pressure as well."""
FOLLOWERS = {
    "slow": ("PI", "PI and knocker", "friction observer"),
    "Signal 1": ("friction observer", "backstepping", "adaptive backstepping"),
    "Signal 2": ("backstepping",),
}
"""What a picture shows of each course."""


class Runs(eqx.Module):
    """One controller along one course, a row for each turbine pressure."""

    time: Float[np.ndarray, " time"]
    """s"""
    reference: Float[np.ndarray, "pressures time"]
    """m"""
    position: Float[np.ndarray, "pressures time"]
    """True position in m."""
    unseen: Float[np.ndarray, "pressures time"]
    """True chamber pressure less the one that the controller believes in, in Pa; zero where it believes in none."""

    @property
    def error(self) -> Float[np.ndarray, "pressures time"]:
        """Reference less true position in m."""
        return self.reference - self.position

    def peak(self, after: float = SETTLED) -> tuple[float, ...]:
        """Largest error in mm from a time in s on, at each pressure."""
        return tuple(1e3 * np.abs(self.error[:, self.time >= after]).max(axis=1))

    def rms(self) -> tuple[float, ...]:
        """Root mean square error in mm, at each pressure."""
        return tuple(1e3 * np.sqrt(np.mean(np.square(self.error[:, self.time >= SETTLED]), axis=1)))


@functools.cache
def runs(controller: str, course: str, *, frictionless: bool = False) -> Runs:
    """A controller along a course, both by name, on the plant at the turbine pressures of [`loops`][]."""
    model = plant()
    if frictionless:
        forces = {f"friction.{name}": FRICTIONLESS for name in ("static_force", "coulomb_force")}
        model = vgtjax.replace_parameters(model, forces)
    on = COURSES[course]
    return Runs(*map(np.asarray, _follow(model, CONTROLLERS[controller](), _scenarios(on), on.duration)))


@eqx.filter_jit
def _follow(
    plant: vgtjax.Actuator, controller: AbstractController, scenarios: Scenario, duration: float
) -> tuple[Array, Array, Array, Array]:
    """What [`Runs`][] holds."""

    def lane(scenario: Scenario) -> tuple[Array, Array, Array, Array]:
        loop = control.close_loop(plant, controller, scenario, duration, throw=False)
        observed = loop.observed("pressure")
        believed = loop.pressure if observed is None else observed
        return loop.time, loop.reference.position, loop.position, loop.pressure - believed

    return jax.vmap(lane, out_axes=(None, 0, 0, 0))(scenarios)


def _scenarios(course: Course) -> Scenario:
    """One for each turbine pressure of [`loops`][], with noise of its own."""
    keys = jax.random.split(jax.random.key(SEED), len(OPERATING_POINTS))
    return jax.vmap(course.scenario)(jnp.asarray(OPERATING_POINTS), keys)


@dataclasses.dataclass(frozen=True, eq=False)
class Fleet:
    """Errors of many units along Signal 1: in mm, and of the observed pressure in Pa, NaN where none is observed."""

    peak: Float[np.ndarray, "units pressures"]
    rms: Float[np.ndarray, "units pressures"]
    unseen: Float[np.ndarray, "units pressures"]


@functools.cache
def fleet(controller: str) -> Fleet:
    """A controller with one set of gains on twenty actuators, fitted to simulated traces and unknown to it."""
    units = read_actuators(FLEET, load_study(FLEET), None).fitted.values()
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *units)
    course = COURSES["Signal 1"]
    peak, rms, unseen = _errors(stacked, CONTROLLERS[controller](), _scenarios(course), course.duration)
    return Fleet(1e3 * np.asarray(peak), 1e3 * np.asarray(rms), np.asarray(unseen))


@eqx.filter_jit
def _errors(
    units: vgtjax.Actuator, controller: AbstractController, scenarios: Scenario, duration: float
) -> tuple[Array, Array, Array]:
    """Peak and root mean square in m, and that of the observed pressure in Pa, of every unit under every scenario."""

    def lane(unit: vgtjax.Actuator, scenario: Scenario) -> tuple[Array, Array, Array]:
        loop = control.close_loop(unit, controller, scenario, duration, throw=False)
        peak, rms = control.tracking_peak(loop, SETTLED), control.tracking_rms(loop, SETTLED)
        return peak, rms, control.pressure_rms(loop, SETTLED)

    return jax.vmap(jax.vmap(lane, (None, 0)), (0, None))(units, scenarios)
