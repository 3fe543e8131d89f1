"""Effective flow areas of the converter against its plunger's position, and the chamber's volume [2.33, B.2, B.3]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.optimize import least_squares

from ..actuator import Actuator
from ..chamber import Gas
from ..line import NoLine
from ..parameters import Selection, entry_names, get_parameter, parameter_table, replace_parameters, select
from ..trace import Trace
from ..transforms import build_transform
from .chamber_flow import NEEDS, ChamberRecord, flow_through, read_chamber, usable, without_position
from .filters import duty_steps
from .regression import clustered_errors, determined, usual_factor
from .result import Curve, Identified

LAWS = (
    "converter.reservoir_orifice_slope",
    "converter.reservoir_orifice_saturation",
    "converter.atmosphere_orifice",
    "chamber.volume",
)
LEAST_LIFT = 10e-6
"""m; below, the plunger's position is no better known than to its size."""
MARGIN = 2000.0
"""Pa between chamber and source; nearer, the flow depends on the pressures' difference more than on the area."""
AFTER_STEP = 0.02
"""s after a duty step in which smoothing and the plunger's mass, which is left out, make its position uncertain."""
WORST = 0.3
"""Relative standard error above which a value counts as not seen, and stays what the model has."""
OUTLIER = 3.0
"""Standard deviations beyond which a residual counts by its size instead of its square."""
CLUSTER = 0.2
"""s; errors of neighbouring samples are taken for independent beyond this: longer than any window of the filters."""
PASSES = 2
"""The temperatures depend on the volume that is looked for, though little: once more is enough."""
SHOWN = 1500
"""Points in a picture."""


class _Samples(eqx.Module):
    """Samples with a significant flow, of all traces, each `(samples,)`: lift in m, pressures in Pa, and so on."""

    lift: Array
    pressure: Array
    temperature: Array
    position: Array
    velocity: Array
    reservoir: Array
    ambient: Array
    rate: Array
    rate_error: Array
    area: Array
    group: Int[np.ndarray, " samples"]
    stepped: bool
    """Whether any trace steps the duty. A slow ramp tells the volume only through small differences of large flows."""


def identify_flow_areas(model: Actuator, traces: Sequence[Trace]) -> Identified:
    """Slope and saturation of the reservoir's orifice [B.2], `c0..c2` of the atmosphere's [B.3], and the volume `V_0`.

    The plunger's position comes point by point from the force balance [2.7] with the model's magnetic force,
    stiffnesses and damping; its mass is left out. The chamber's energy balance (2.33, adiabatic where the chamber is,
    errata 3 and 9) then gives the rate of the pressure for any areas and volume, and these are fitted to the measured
    rate. Standard errors hold for the stiffnesses that the model has: softer springs with steeper areas do the same.

    **Returns:** those of the five that the traces tell; `converter.atmosphere_orifice` has NaN as standard error
    where an entry kept the model's value.
    """
    start, used = model, usable(traces)
    for _ in range(PASSES):
        samples = _gather(model, [read_chamber(model, trace) for trace in used])
        if samples is None:
            return Identified(
                name="flow areas",
                equations="2.33, B.2, B.3",
                method="no flow was found",
                unseen=(f"no sample with a significant flow was found: step the duty ({NEEDS})",),
            )
        fit = _fit(start, samples)
        model = fit.model
    values, errors, unseen = _by_name(start, fit)
    line = () if isinstance(model.line, NoLine) else ("the line is not resolved: its resistance counts as orifice",)
    return Identified(
        name="flow areas",
        equations="2.33, B.2, B.3",
        method=f"{len(samples.lift)} samples of {len(used)} traces with flow; areas and volume by nonlinear least "
        "squares of the pressure's rate, with the model's springs of the plunger",
        values=values,
        std_errors=errors,
        unseen=(*unseen, *line, *without_position(traces)),
        figures=(_figure(model, samples),),
        samples=len(samples.lift),
    )


def plunger_lift(model: Actuator, record: ChamberRecord) -> Float[np.ndarray, " time"]:
    """Position of the plunger in m along a trace [2.7], from the measured pressures and the duty.

    Backward differences of `b_p x' = F - k x`: the mass acts within half a millisecond only.
    """
    time = np.asarray(record.trace.time)
    interval = np.append(np.diff(time), np.median(np.diff(time)))
    return np.asarray(
        _march_plunger(
            model,
            interval,
            record.trace.pwm,
            record.pressure.value,
            record.reservoir,
            np.full_like(time, record.ambient),
        )
    )


@eqx.filter_jit
def _march_plunger(
    model: Actuator, interval: Array, pwm: Array, pressure: Array, reservoir: Array, ambient: Array
) -> Array:
    converter = model.converter

    def one(lift, inputs):
        dt, duty, p, reservoir, ambient = inputs
        pull = converter.magnet.steady_pull(duty, lift)
        drag = converter.plunger_damping / dt
        force = converter.static_force(pull, ambient, reservoir, p) + drag * lift
        springs = converter.membrane_stiffness + jnp.where(force > 0, converter.return_spring_stiffness, 0.0)
        # The lift at the end of an interval, which the next sample sees.
        return force / (springs + drag), lift

    first = converter.rest_position(pwm[0], ambient[0], reservoir[0], pressure[0])
    return jax.lax.scan(one, first, (interval, pwm, pressure, reservoir, ambient))[1]


def _gather(model: Actuator, records: list[ChamberRecord]) -> _Samples | None:
    parts, clusters = [], 0
    for record in records:
        lift = plunger_lift(model, record)
        flows = _flows(record, lift)
        time = record.trace.time
        group = clusters + ((time - time[0]) / CLUSTER).astype(int)
        clusters = int(group[-1]) + 1
        signals = (
            lift,
            record.pressure.value,
            record.temperature,
            record.position.value,
            record.position.rate,
            record.reservoir,
            np.full_like(time, record.ambient),
            record.pressure.rate,
            record.area_error * record.per_area,
            record.area,
            group,
        )
        parts.append([signal[flows] for signal in signals])
    if not any(len(part[0]) for part in parts):
        return None
    stepped = any(len(duty_steps(record.trace)) for record in records)
    return _Samples(*(np.concatenate(signal) for signal in zip(*parts, strict=True)), stepped)


def _flows(record: ChamberRecord, lift: Float[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
    """Where a flow is to be expected and known well: chosen by lift and pressures, not by the noisy rate itself."""
    time, pressure = record.trace.time, record.pressure.value
    emptying = (lift < -LEAST_LIFT) & (pressure > record.reservoir + MARGIN)
    filling = (lift > LEAST_LIFT) & (pressure < record.ambient - MARGIN)
    jumps = np.concatenate([[-np.inf], time[duty_steps(record.trace)]])
    since = time - jumps[np.searchsorted(jumps, time, side="right") - 1]
    until = np.append(jumps[1:], np.inf)[np.searchsorted(jumps, time, side="right") - 1] - time
    return (emptying | filling) & (since > AFTER_STEP) & (until > AFTER_STEP) & np.isfinite(record.area)


@dataclasses.dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted model, which entries were free, and their standard errors."""

    model: Actuator
    selection: Selection
    std_errors: Float[np.ndarray, " free"]


def _fit(start: Actuator, samples: _Samples) -> _Fit:
    """Least squares of the pressure's rate; entries that it does not tell are held, and the rest fitted again."""
    free = select(start, LAWS, fixed=() if samples.stepped else ("chamber.volume",))
    for _ in range(len(free.entries)):
        model, residuals, columns = _minimise(start, free, samples)
        errors = clustered_errors(residuals, columns, samples.group)
        relative = columns * np.abs(np.asarray(free.pack(model)))
        told = determined(relative, usual_factor(columns, errors), WORST)
        if np.all(told):
            break
        free = Selection(tuple(entry for entry, seen in zip(free.entries, told, strict=True) if seen))
        if not free.entries:
            return _Fit(start, free, np.zeros(0))
    return _Fit(model, free, errors)


def _minimise(start: Actuator, free: Selection, samples: _Samples) -> tuple[Actuator, np.ndarray, np.ndarray]:
    """The fitted model, its residuals in units of noise, and their derivatives by the free entries."""
    values = np.asarray(free.pack(start))
    transform = build_transform(parameter_table(start), free.entries, values, {})

    @jax.jit
    def residuals(coordinates: Array) -> Array:
        return _residuals(free.unpack(start, transform.to_physical(coordinates)), samples)

    with np.errstate(over="ignore", invalid="ignore"):  # a wild trial is refused, whatever its squares
        answer = least_squares(
            lambda y: np.asarray(residuals(y)),
            np.asarray(transform.to_coordinates(values)),
            jac=lambda y: np.asarray(jax.jacfwd(residuals)(y)),
            loss="soft_l1",  # corners that the filter cut, and the chatter of a plunger at zero
            f_scale=OUTLIER,
            x_scale="jac",
        )
    slope = np.asarray(jax.jvp(transform.to_physical, (answer.x,), (np.ones_like(answer.x),))[1])
    # By the loss, as residuals and columns whose squares are its own to first order.
    weight = (1 + (np.asarray(residuals(answer.x)) / OUTLIER) ** 2) ** -0.25
    columns = np.asarray(jax.jacfwd(residuals)(answer.x)) / slope
    model = free.unpack(start, np.asarray(transform.to_physical(answer.x)))
    return model, np.asarray(residuals(answer.x)) * weight, columns * weight[:, None]


@eqx.filter_jit
def _residuals(model: Actuator, samples: _Samples) -> Float[Array, " samples"]:
    """Rate of the pressure by the model less the measured one, in units of its noise."""
    converter, displaced = model.converter, model.diaphragm.displaced_volume

    def one(s):
        area = jnp.where(s.lift < 0, -1.0, 1.0) * converter.orifice_area(s.lift)
        flow = flow_through(model, area, s.pressure, s.temperature, s.reservoir, s.ambient)
        gas = Gas(s.pressure, s.temperature)
        rate = model.chamber.rates(model.air, gas, flow, displaced(s.position), displaced(s.velocity)).pressure
        return (rate - s.rate) / s.rate_error

    return jax.vmap(one)(eqx.filter(samples, eqx.is_array))


def _by_name(start: Actuator, fit: _Fit) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], tuple[str, ...]]:
    """Values and standard errors by name, and the sentence about entries that were held."""
    return gather_entries(start, fit.model, LAWS, dict(zip(fit.selection.entries, fit.std_errors, strict=True)))


def gather_entries(
    start: Any, model: Any, names: Sequence[str], errors: dict[str, float]
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], tuple[str, ...]]:
    """What an [`Identified`][] wants of a fit: values and standard errors by name, a sentence about what was held.

    **Arguments:** `start` and fitted `model`, the parameters' names, and the standard errors of the fitted entries.
    """
    values, std_errors, held = {}, {}, []
    for name in names:
        entries = entry_names({name: parameter_table(start)[name]})
        held += [entry for entry in entries if entry not in errors]
        if any(entry in errors for entry in entries):
            values[name] = np.asarray(get_parameter(model, name))
            std_errors[name] = np.reshape([errors.get(entry, np.nan) for entry in entries], values[name].shape)
    if not held:
        return values, std_errors, ()
    return values, std_errors, (f"these traces don't tell {', '.join(held)}, which kept the model's values",)


def _figure(model: Actuator, samples: _Samples) -> Curve:
    thinned = slice(None, None, max(len(samples.lift) // SHOWN, 1))
    lift, area = np.asarray(samples.lift)[thinned], np.asarray(samples.area)[thinned]
    grid = np.linspace(min(np.min(lift), 0.0), max(np.max(lift), 0.0), 400)
    law = np.asarray(jax.vmap(model.converter.orifice_area)(grid))
    return Curve(
        "plunger position / mm",
        "effective area / mm2",
        (lift * 1e3, np.abs(area) * 1e6),
        (grid * 1e3, law * 1e6),
        "Effective flow area [2.33]: reservoir below zero, atmosphere above",
    )
