"""Simulated bench tests of the printed actuator; each is run once."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

import vgtjax
from vgtjax.experiments import HysteresisLoop, find_loop
from vgtjax.traces import ASSUMED_RESERVOIR, STANDARD_ATMOSPHERE

MBAR = 100.0
"""Pa."""
DUTIES = (50.0, 80.0, 100.0)
"""%; the steps of section 2.3."""
TOP = 7e4
"""Pa; applied pressure of a ramp that closes the vanes."""
RATE = 2.5e3
"""Pa/s of applied pressure on a ramp: half a millimetre per second, so that friction's loop is seen and not damping."""
SAMPLES = 200
"""Samples per second of a ramp."""
HOLD = 4.0
"""s; how long a duty is held. After 4 s pressure moves by less than 0.1 mbar/s."""


@dataclasses.dataclass(frozen=True, eq=False)
class Response:
    """Pressure and position after one step of the duty; `time` in s counts from the step."""

    time: Float[np.ndarray, " time"]
    pressure: Float[np.ndarray, " time"]
    """Pa absolute."""
    position: Float[np.ndarray, " time"]
    """m."""

    def time_to(self, signal: str, fraction: float) -> float:
        """Time in s at which a signal has made a fraction of its whole way."""
        way = self._way(signal)
        after = int(np.argmax(way >= fraction))
        return float(np.interp(fraction, way[after - 1 : after + 1], self.time[after - 1 : after + 1]))

    def fraction_at(self, signal: str, time: float) -> float:
        """Fraction of its way that a signal has made at a time in s."""
        return float(np.interp(time, self.time, self._way(signal)))

    def _way(self, signal: str) -> np.ndarray:
        values = getattr(self, signal)
        return (values - values[0]) / (values[-1] - values[0])


@functools.cache
def actuator() -> vgtjax.Actuator:
    """The printed parameters."""
    return vgtjax.Actuator()


def small_areas() -> vgtjax.Actuator:
    """Orifice areas divided by gamma, in case they were identified with the isothermal (2.33)."""
    printed = actuator()
    names = ("converter.reservoir_orifice_slope", "converter.atmosphere_orifice")
    gamma = printed.air.heat_capacity_ratio
    return vgtjax.replace_parameters(printed, {name: vgtjax.get_parameter(printed, name) / gamma for name in names})


@functools.cache
def duty_pulse(duty: float, reservoir: float = ASSUMED_RESERVOIR, divided: bool = False) -> vgtjax.Solution:
    """A duty in percent, held and released, with a reservoir in Pa absolute; `divided` as in [`small_areas`][]."""
    time = np.arange(0.0, 2 * HOLD, 1e-3)
    pwm = np.where(time < HOLD, duty, 0.0)
    # A first sample without duty says that the actuator starts at rest.
    pwm[0] = 0.0
    trace = vgtjax.Trace(time=time, pwm=pwm, p_res=np.full_like(time, reservoir))
    return vgtjax.simulate(small_areas() if divided else actuator(), trace)


def response(duty: float, *, released: bool = False, **options: float | bool) -> Response:
    """What follows the step to a duty in percent, or its release."""
    solution = duty_pulse(duty, **options)
    time = np.asarray(solution.time)
    part = time >= HOLD if released else (time > 0) & (time < HOLD)
    time, pressure, position = (np.asarray(x)[part] for x in (time, solution.p_act, solution.x_d))
    return Response(time - time[0], pressure, position)


def mechanical(
    friction: vgtjax.AbstractFriction | None = None, vane_force: vgtjax.AbstractVaneForce | None = None
) -> vgtjax.MechanicalActuator:
    """Diaphragm and rod with printed parameters; LuGre friction and no exhaust gas by default."""
    return vgtjax.MechanicalActuator(
        friction=vgtjax.LuGre() if friction is None else friction,
        vane_force=vgtjax.NoVaneForce() if vane_force is None else vane_force,
    )


def pressure_path(model: vgtjax.MechanicalActuator, corners: Sequence[float], turbine: float = 0.0) -> vgtjax.Solution:
    """Applied pressure from corner to corner at `RATE`, at a turbine pressure; both in Pa gauge."""
    at = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))]) / RATE
    time = np.linspace(0.0, at[-1], round(SAMPLES * at[-1]) + 1)
    pressure = STANDARD_ATMOSPHERE - np.interp(time, at, corners)
    # The model asks for a position, which is its start.
    trace = vgtjax.Trace(time=time, p_act=pressure, p_trb=np.full_like(time, turbine), x_d=np.zeros_like(time))
    return vgtjax.simulate(model, trace)


def pressure_ramp(model: vgtjax.MechanicalActuator, top: float, turbine: float = 0.0) -> vgtjax.Solution:
    """Applied pressure up to `top` and back."""
    return pressure_path(model, (0.0, top, 0.0), turbine)


def loop_of(run: vgtjax.Solution | vgtjax.Trace) -> HysteresisLoop:
    """The hysteresis loop of a pressure ramp."""
    loop = find_loop(np.asarray(run.time), np.asarray(run.x_d), np.asarray(run.p_act))
    assert loop is not None, "such a ramp crosses the whole travel"
    return loop


def closing_pressure(solution: vgtjax.Solution) -> float:
    """Applied pressure in Pa at which a ramp first brings the rod to its closed stop."""
    closed = np.asarray(solution.x_d) >= float(actuator().diaphragm.travel)
    return STANDARD_ATMOSPHERE - float(solution.p_act[int(np.argmax(closed))])
