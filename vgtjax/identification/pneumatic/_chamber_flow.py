"""Flow through the converter, from the measured chamber pressure [2.33]."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._types import Scalar
from ...parts import Flow, GasState, orifice_flow
from ...plants import Actuator
from ...traces import Trace, noise_level
from .. import _limits as limits
from .._filters import Offset, Samples, Smooth, reservoir_pressure, sensor_offset, smooth


@dataclasses.dataclass(frozen=True, eq=False)
class ChamberRecord:
    """The gas in the chamber along one trace, each array of shape `(time,)`.

    `pressure` (Pa absolute) and `position` (m) are smoothed, and free of their sensors' offsets where the trace
    determines them. `temperature` in K. `area` is the effective area of the open orifice in m2, positive from the
    atmosphere and negative to the reservoir, NaN where pressures are too equal. `rate_error` (Pa/s) is the standard
    deviation of that part of the pressure's rate which the flow makes. `per_area` (Pa/s/m2) and `per_velocity` (Pa/m)
    are derivatives of the pressure's rate with respect to the size of that area and to the diaphragm's velocity.
    """

    trace: Trace
    pressure: Smooth
    position: Smooth
    reservoir: Samples
    temperature: Samples
    area: Samples
    rate_error: Samples
    per_area: Samples
    per_velocity: Samples
    offset: Offset
    """Of the pressure sensor."""

    @property
    def ambient(self) -> float:
        """Atmosphere in Pa."""
        return self.trace.atmosphere

    @property
    def area_error(self) -> Samples:
        """Standard deviation of the area in m2, infinite where nothing can flow."""
        return np.divide(self.rate_error, self.per_area, out=np.full_like(self.area, np.inf), where=self.per_area > 0)


def usable(traces: Sequence[Trace]) -> list[Trace]:
    """Traces that have what the pneumatic half needs, a duty and the chamber pressure, each on one clock."""
    return [trace.on_one_clock() for trace in traces if trace.pwm is not None and trace.p_act is not None]


NEEDS = "traces need the columns pwm and p_act"


def without_position(traces: Sequence[Trace]) -> tuple[str, ...]:
    """The sentence about traces that lack a measured position, if any."""
    names = [trace.name for trace in usable(traces) if trace.x_d is None]
    if not names:
        return ()
    return (
        f"{', '.join(names)} without x_d: the diaphragm is taken where its spring balances the pressure, so "
        "friction shifts the chamber's volume by percents",
    )


def diaphragm_motion(model: Actuator, trace: Trace, pressure: Smooth) -> Smooth:
    """Position of the diaphragm in m, measured and smoothed, or from static balance where it was not measured."""
    if trace.x_d is not None:
        motion = smooth(trace.time, trace.x_d, noise_level(trace.x_d, "x_d"))
        return dataclasses.replace(motion, value=motion.value - sensor_offset(model, trace, "x_d").value)
    area = float(model.diaphragm.area)
    force = (trace.atmosphere - pressure.value) * area
    compliance = 1 / float(model.diaphragm.stiffness)
    position = np.asarray(model.diaphragm.rest_position(force))
    moving = (position > 0) & (position < float(model.diaphragm.travel))
    return Smooth(
        position,
        np.where(moving, -pressure.rate * area * compliance, 0.0),
        pressure.value_error * area * compliance,
        pressure.rate_error * area * compliance,
    )


def read_chamber(model: Actuator, trace: Trace) -> ChamberRecord:
    """Flow and temperature in the chamber along a trace, from its measured pressure and position [2.33, errata]."""
    assert trace.p_act is not None
    offset = sensor_offset(model, trace, "p_act")
    pressure = smooth(trace.time, trace.p_act, noise_level(trace.p_act, "p_act"))
    pressure = dataclasses.replace(pressure, value=pressure.value - offset.value)
    position = diaphragm_motion(model, trace, pressure)
    reservoir = reservoir_pressure(trace)
    temperature, area, per_area, per_velocity = march(
        _gas,
        model,
        np.append(np.diff(trace.time), 0.0),
        pressure.value,
        pressure.rate,
        position.value,
        position.rate,
        reservoir,
        np.full_like(reservoir, trace.atmosphere),
    )
    error = np.hypot(pressure.rate_error, per_velocity * position.rate_error)
    return ChamberRecord(trace, pressure, position, reservoir, temperature, area, error, per_area, per_velocity, offset)


def flow_through(
    model: Actuator, area: Array, pressure: Array, temperature: Array, reservoir: Array, ambient: Array
) -> Flow:
    """Flow into the chamber through an area in m2, from the atmosphere where positive, to the reservoir where not."""
    source = jnp.where(area < 0, reservoir, ambient)
    return Flow(*orifice_flow(model.air, jnp.abs(area), source, pressure, temperature))


BLOCK = 4000
"""Samples; signals are padded to multiples of it, so that few programs are compiled for traces of many lengths."""


def march(function: Callable[..., Any], model: Actuator, *signals: Samples) -> list[Samples]:
    """What a compiled function of a model and signals `(time,)` returns, with signals held on through their padding."""
    length = len(signals[0])
    padded = [np.pad(signal, (0, -length % BLOCK), mode="edge") for signal in signals]
    return [np.asarray(answer)[:length] for answer in function(model, *padded)]


@eqx.filter_jit
def _gas(
    model: Actuator,
    interval: Float[Array, " time"],
    pressure: Float[Array, " time"],
    pressure_rate: Float[Array, " time"],
    position: Float[Array, " time"],
    velocity: Float[Array, " time"],
    reservoir: Float[Array, " time"],
    ambient: Float[Array, " time"],
) -> tuple[Array, Array, Array, Array]:
    """Temperature, signed area, and how the pressure's rate depends on area and on the diaphragm's velocity."""

    def one(temperature, inputs):
        dt, here, halfway = inputs
        heating, *read = _read_flow(model, temperature, *here)
        between = temperature + 0.5 * dt * heating
        return temperature + dt * _read_flow(model, between, *halfway)[0], (temperature, *read)

    signals = (pressure, pressure_rate, position, velocity, reservoir, ambient)
    middles = tuple(0.5 * (signal + jnp.append(signal[1:], signal[-1])) for signal in signals)
    return jax.lax.scan(one, jnp.asarray(model.air.temperature), (interval, signals, middles))[1]


def _read_flow(
    model: Actuator,
    temperature: Scalar,
    pressure: Scalar,
    rate: Scalar,
    position: Scalar,
    velocity: Scalar,
    reservoir: Scalar,
    ambient: Scalar,
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Rate of the temperature, and what `_gas` returns, at one time: the energy balance solved for the flow."""
    gas, displaced = GasState(pressure, temperature), model.diaphragm.displaced_volume

    def rates_with(flow: Flow, velocity: Scalar) -> GasState:
        return model.chamber.rates(model.air, gas, flow, displaced(position), displaced(velocity))

    none = Flow(jnp.zeros_like(pressure), temperature)
    still = rates_with(none, velocity).pressure
    side = jnp.where(rate < still, -1.0, 1.0)
    unit = flow_through(model, side, pressure, temperature, reservoir, ambient)
    per_mass = rates_with(Flow(jnp.ones_like(pressure), unit.temperature), velocity).pressure - still
    mass_flow = (rate - still) / per_mass
    clear = jnp.abs(unit.mass_flow) > limits.FLOW_LEAST * pressure / jnp.sqrt(model.air.gas_constant * temperature)
    area = jnp.where(clear, side * mass_flow / jnp.where(clear, unit.mass_flow, 1.0), jnp.nan)
    heating = rates_with(Flow(mass_flow, unit.temperature), velocity).temperature
    per_velocity = rates_with(none, velocity + 1.0).pressure - still
    return heating, area, jnp.abs(per_mass * unit.mass_flow), per_velocity
