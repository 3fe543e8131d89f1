"""A trace as the motion of a mass under a force, its sensors' offsets and the noise of the drive removed."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from ...parts import Contact, DryFriction, LuGre, Vanes
from ...plants import AbstractModel, AbstractRodModel, Actuator, MechanicalActuator
from ...traces import MOVES, SENSOR_PRESSURE_OFFSET, START_WINDOW, Trace, drift_of
from .. import _limits as limits
from .._filters import Samples, resting
from .._result import NotPossible
from ._clean_signals import CleanSignals, clean_signals, even


@dataclasses.dataclass(frozen=True, eq=False)
class MotionRecord:
    """Force and position along one trace, arrays of shape `(time,)`.

    `time` in s, evenly spaced; the driving `force` along +x in N and the `position` in m, both without their sensors'
    offsets where rest determines them. `noise` is the standard deviation of one position in m, `drive_noise` of one
    pressure in Pa (0 for a force), `force_error` and `position_error` are what remains unknown of the offsets. `rest`
    is before anything moves. `trace` has the same drive, without noise, for a simulation, `place` and `offset` are what
    was taken out of position (m) and pressure (Pa).
    """

    trace: Trace
    time: Samples
    force: Samples
    position: Samples
    noise: float
    force_error: float
    position_error: float
    rest: Bool[np.ndarray, " time"]
    signals: CleanSignals
    drive_noise: float = 0.0
    place: float = 0.0
    offset: float = 0.0

    @property
    def smooth_position(self) -> Samples:
        """Position in m without the noise of its sensor."""
        return self.signals.position - self.place

    def measured_again(self, experiment: int) -> Trace:
        """`trace` as another measurement of the same pressure would have it."""
        if self.drive_noise == 0:
            return self.trace
        return self.trace.replace(p_act=self.signals.pressure_again(experiment) - self.offset)

    def constant_error(self, stiffness: float) -> float:
        """Standard error in N of a constant in the balance of forces, by both offsets and a spring in N/m."""
        return float(np.hypot(self.force_error, stiffness * self.position_error))

    @property
    def interval(self) -> float:
        """Time between two samples in s."""
        return float(self.time[1] - self.time[0])


def mechanical_half(model: AbstractModel) -> MechanicalActuator:
    """Diaphragm, friction and vanes of a model."""
    assert isinstance(model, AbstractRodModel), "mechanical tests are asked of models with a rod"
    return MechanicalActuator(rod=model.rod, air=model.air)


def dry_friction(model: MechanicalActuator) -> DryFriction:
    """The friction of a model in the thesis's terms.

    **Raises:** `NotPossible` for a law that has no Coulomb force.
    """
    found = model.friction.dry()
    if found is None:
        law = type(model.friction).__name__
        raise NotPossible(f"the model's friction, {law}, has no Coulomb force; choose e.g. LuGre or Coulomb")
    return found


def dry_level(model: MechanicalActuator) -> float:
    """Coulomb force in N against which a model's rod counts as pushed, the printed one for a law that has none."""
    return float((model.friction.dry() or LuGre()).coulomb_force)


def sliding_law(model: MechanicalActuator, velocity: Samples) -> Samples:
    """Friction in N of a model that slides steadily without exhaust gas at velocities in m/s."""
    contact = Contact(jnp.asarray(velocity), model.diaphragm.mass, Vanes(jnp.asarray(0.0), jnp.asarray(0.0)))
    return np.asarray(model.friction.steady_force(contact))


def read_motions(model: AbstractModel, traces: Sequence[Trace]) -> list[MotionRecord]:
    """What the mechanical identifications see of traces; those without a drive or a position are left out."""
    return [read_motion(mechanical_half(model), trace) for trace in usable(traces)]


def usable(traces: Sequence[Trace]) -> list[Trace]:
    """Traces that have a drive and a position."""
    return [trace for trace in traces if trace.x_d is not None and not (trace.p_act is None and trace.f_drive is None)]


def read_motion(model: MechanicalActuator, trace: Trace) -> MotionRecord:
    """One trace that has a drive and a position."""
    signals, trace = clean_signals(trace), even(trace)
    assert trace.x_d is not None
    time = trace.time[0] + (trace.time[-1] - trace.time[0]) / (len(trace.time) - 1) * np.arange(len(trace.time))
    if trace.f_drive is not None:
        # A force that a command states has no noise to remove, and often jumps.
        rest = np.zeros(len(time), dtype=bool)
        return MotionRecord(
            trace, time, trace.f_drive, trace.x_d, signals.noise, 0.0, limits.POSITION_ERROR, rest, signals
        )
    assert trace.p_act is not None
    rest = _resting(model, trace)
    rest &= abs(drift_of(trace.p_act[rest])) <= MOVES
    area, count = float(model.diaphragm.area), int(np.sum(rest))
    if count == 0:
        offset, place, position_error, pressure_error = 0.0, 0.0, limits.POSITION_ERROR, 0.5 * SENSOR_PRESSURE_OFFSET
    else:
        offset = float(np.mean(trace.p_act[rest])) - trace.atmosphere
        place = float(np.mean(trace.x_d[rest])) - float(model.diaphragm.rest_position(np.asarray(0.0)))
        position_error, pressure_error = signals.noise / np.sqrt(count), signals.pressure_noise / np.sqrt(count)
    # The simulation counts pressure from the model's own ambient, as the trace does.
    ambient = float(model.air.pressure) + float(trace.drive().ambient_shift[0])
    return MotionRecord(
        trace=trace.replace(p_act=signals.pressure - offset),
        time=time,
        force=(ambient - (trace.p_act - offset)) * area,
        position=trace.x_d - place,
        noise=signals.noise,
        force_error=area * pressure_error,
        position_error=position_error,
        rest=rest,
        signals=signals,
        drive_noise=signals.pressure_noise,
        place=place,
        offset=offset,
    )


def _resting(model: MechanicalActuator, trace: Trace) -> Bool[np.ndarray, " time"]:
    """Samples at the start of a trace at which the chamber is at atmosphere and the rod on its open stop."""
    if trace.pwm is not None:
        # Which duty closes the valve hardly differs between valves; half of it is margin enough.
        return resting(Actuator(diaphragm=model.diaphragm), trace)
    return (trace.time <= trace.time[0] + START_WINDOW) & bool(trace.start().at_rest)
