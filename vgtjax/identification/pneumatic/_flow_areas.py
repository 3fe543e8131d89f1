"""Effective flow areas of the converter against its plunger's position, and the chamber's volume [2.33, B.2, B.3]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float, Int

from ..._types import Vector
from ...estimation import clustered_errors, determined_within, error_factor
from ...parameters import Selection, Transform, build_transform, entry_names, get_parameter, parameter_table, select
from ...parts import GasState, NoLine
from ...plants import Actuator
from ...traces import Trace
from .. import _limits as limits
from .._filters import duty_steps
from .._result import Curve, Identified, NotPossible, bench_test, thinned
from ._chamber_flow import BLOCK, NEEDS, ChamberRecord, flow_through, march, read_chamber, usable, without_position

LAWS = (
    "converter.reservoir_orifice_slope",
    "converter.reservoir_orifice_saturation",
    "converter.atmosphere_orifice",
    "chamber.volume",
)
OUTLIER = 3.0
"""Standard deviations beyond which a residual counts by its size instead of its square."""


class _Samples(eqx.Module):
    """Samples with a significant flow, of all traces, each `(samples,)`: lift in m, pressures in Pa, and so on.

    Padded by copies of the last one whose rate has an infinite error.
    """

    lift: Float[np.ndarray, " samples"]
    pressure: Float[np.ndarray, " samples"]
    temperature: Float[np.ndarray, " samples"]
    position: Float[np.ndarray, " samples"]
    velocity: Float[np.ndarray, " samples"]
    reservoir: Float[np.ndarray, " samples"]
    ambient: Float[np.ndarray, " samples"]
    rate: Float[np.ndarray, " samples"]
    rate_error: Float[np.ndarray, " samples"]
    area: Float[np.ndarray, " samples"]
    group: Int[np.ndarray, " samples"]
    count: int = eqx.field(static=True)
    """Samples that are no padding."""
    stepped: bool = eqx.field(static=True)
    """Whether any trace steps the duty. A slow ramp shows the volume only in small differences of large flows."""


@bench_test(
    "flow areas",
    "2.33, B.2, B.3",
    "Nonlinear least squares of the pressure's rate for areas and volume, with the model's springs of the plunger.",
)
def identify_flow_areas(model: Actuator, traces: Sequence[Trace]) -> Identified:
    """Slope and saturation of the reservoir's orifice [B.2], `c0..c2` of the atmosphere's [B.3], and the volume `V_0`.

    Standard errors hold for the stiffnesses that the model has: softer springs with steeper areas do the same.

    **Arguments:** `model`: with the plunger's springs and magnetic force found before; `traces`: with `pwm` in %,
    `p_act` in Pa, and best `x_d` in m.

    **Returns:** those of the five that the traces determine, in the units of the table; `converter.atmosphere_orifice`
    has NaN as standard error where an entry kept the model's value.
    """
    used = usable(traces)
    samples = _gather(model, used)
    if samples is None:
        raise NotPossible(f"no sample with a significant flow was found: step the duty ({NEEDS})")
    # Temperatures depend, though little, on the volume that is looked for: once more with what was found.
    samples = _gather(_fit(model, samples).model, used) or samples
    fit = _fit(model, samples)
    values, errors, limitations = gather_entries(
        model, fit.model, LAWS, dict(zip(fit.selection.entries, fit.std_errors, strict=True))
    )
    return Identified(
        method=f"{samples.count} samples of {len(used)} traces with flow; areas and volume by nonlinear least "
        "squares of the pressure's rate, with the model's springs of the plunger",
        values=values,
        std_errors=errors,
        limitations=(*limitations, *_not_resolved(model), *without_position(traces)),
        figures=(_figure(fit.model, samples),),
        samples=samples.count,
    )


def _not_resolved(model: Actuator) -> tuple[str, ...]:
    """Sentences about parts of the model that are not resolved here."""
    line = "the line is not resolved: its resistance counts as orifice"
    coil = "the coil's current is taken as settled: what it lags counts as flow"
    return (
        *(() if isinstance(model.line, NoLine) else (line,)),
        *(() if "converter.magnetic_force" in parameter_table(model) else (coil,)),
    )


def plunger_lift(model: Actuator, record: ChamberRecord) -> Float[np.ndarray, " time"]:
    """Position of the plunger, without its mass, in m along a trace [2.7], from measured pressures and the duty."""
    trace, pressure = record.trace, record.pressure.value
    interval = np.append(np.diff(trace.time), 0.0)
    ambient = np.full_like(trace.time, record.ambient)
    assert trace.pwm is not None
    return march(_lift, model, interval, trace.pwm, pressure, record.reservoir, ambient)[0]


@eqx.filter_jit
def _lift(
    model: Actuator, interval: Array, pwm: Array, pressure: Array, reservoir: Array, ambient: Array
) -> tuple[Array]:
    converter = model.converter

    def one(lift, inputs):
        dt, duty, (p, p_next), (reservoir, reservoir_next), ambient = inputs
        pull = converter.magnetic_force.steady_pull(duty, lift)
        begin = converter.static_force(pull, ambient, reservoir, p)
        end = converter.static_force(pull, ambient, reservoir_next, p_next)
        springs = converter.stiffness(begin + end)
        lag = converter.plunger_damping / springs
        # Towards a rest that moves steadily, behind which the plunger stays by its lag.
        rest, moved = begin / springs, (end - begin) / springs
        behind = lag * moved / jnp.where(dt > 0, dt, 1.0)
        return rest + moved - behind + (lift - rest + behind) * jnp.exp(-dt / lag), lift

    def ends(signal):
        return signal, jnp.append(signal[1:], signal[-1])

    first = converter.rest_position(pwm[0], ambient[0], reservoir[0], pressure[0])
    return (jax.lax.scan(one, first, (interval, pwm, ends(pressure), ends(reservoir), ambient))[1],)


def _gather(model: Actuator, traces: list[Trace]) -> _Samples | None:
    parts: list[dict[str, np.ndarray]] = []
    clusters = 0
    for trace in traces:
        record = read_chamber(model, trace)
        lift = plunger_lift(model, record)
        group = clusters + ((trace.time - trace.time[0]) / limits.CORRELATION_FLOW).astype(int)
        clusters = int(group[-1]) + 1
        signals = {
            "lift": lift,
            "pressure": record.pressure.value,
            "temperature": record.temperature,
            "position": record.position.value,
            "velocity": record.position.rate,
            "reservoir": record.reservoir,
            "ambient": np.full_like(lift, record.ambient),
            "rate": record.pressure.rate,
            "rate_error": np.hypot(record.rate_error, record.per_area * _area_uncertainty(model, lift)),
            "area": record.area,
            "group": group,
        }
        flows = _flows(record, lift)
        parts.append({name: signal[flows] for name, signal in signals.items()})
    if not any(len(part["lift"]) for part in parts):
        return None
    count = sum(len(part["lift"]) for part in parts)
    joined: dict[str, Any] = {
        name: np.pad(np.concatenate([part[name] for part in parts]), (0, -count % BLOCK), mode="edge")
        for name in parts[0]
    }
    joined["rate_error"][count:] = np.inf
    return _Samples(**joined, count=count, stepped=any(len(duty_steps(trace)) for trace in traces))


def _area_uncertainty(model: Actuator, lift: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """By how much the area changes within the uncertainty of the lift, beside the jump at zero, in m2."""
    area = jax.vmap(model.converter.orifice_area)
    away = np.where(lift < 0, -limits.LIFT_ERROR, limits.LIFT_ERROR)
    return np.abs(np.asarray(area(lift + away) - area(lift)))


def _flows(record: ChamberRecord, lift: Float[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
    """Where a flow is to be expected and known well: chosen by lift and pressures, not by the noisy rate itself."""
    time, pressure = record.trace.time, record.pressure.value
    emptying = (lift < -limits.FLOW_LIFT) & (pressure > record.reservoir + limits.FLOW_MARGIN)
    filling = (lift > limits.FLOW_LIFT) & (pressure < record.ambient - limits.FLOW_MARGIN)
    jumps = np.concatenate([[-np.inf], time[duty_steps(record.trace)]])
    since = time - jumps[np.searchsorted(jumps, time, side="right") - 1]
    until = np.append(jumps[1:], np.inf)[np.searchsorted(jumps, time, side="right") - 1] - time
    settled = (since > limits.FLOW_SETTLING) & (until > limits.FLOW_SETTLING)
    return (emptying | filling) & settled & np.isfinite(record.area)


@dataclasses.dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted model, which entries were free, and their standard errors."""

    model: Actuator
    selection: Selection
    std_errors: Float[np.ndarray, " free"]


def _fit(start: Actuator, samples: _Samples) -> _Fit:
    """Least squares of the pressure's rate; entries that it does not determine are held, the rest fitted again."""
    every = select(start, LAWS)
    free = np.array([samples.stepped or entry != "chamber.volume" for entry in every.entries])
    while np.any(free):
        model, residuals, columns = _minimise(start, every, free, samples)
        errors = clustered_errors(residuals, columns, samples.group)
        values = every.values(model)[free]
        good = determined_within(columns * np.abs(values), error_factor(columns, errors), limits.ERROR)
        if np.all(good):
            chosen = Selection(tuple(np.array(every.entries)[free].tolist()))
            return _Fit(model, chosen, np.hypot(errors, limits.METHOD_ERROR * np.abs(values)))
        free[free] = good
    return _Fit(start, Selection(()), np.zeros(0))


def _minimise(
    start: Actuator, every: Selection, free: Bool[np.ndarray, " entries"], samples: _Samples
) -> tuple[Actuator, np.ndarray, np.ndarray]:
    """The fitted model, its residuals in units of noise, and their derivatives with respect to the free entries."""
    values = every.values(start)
    transform = build_transform(parameter_table(start), every.entries, values, {})
    fixed = np.asarray(transform.to_coordinates(values))
    guess, low, high = _reach(fixed, every, samples)

    def whole(y: np.ndarray) -> np.ndarray:
        coordinates = fixed.copy()
        coordinates[free] = y
        return coordinates

    def improve(y: np.ndarray, loss: str, tolerance: float) -> np.ndarray:
        return scipy.optimize.least_squares(
            lambda y: np.asarray(_residuals(whole(y), start, every, transform, samples)),
            np.clip(y, low[free], high[free]),
            jac=lambda y: np.asarray(_jacobian(whole(y), start, every, transform, samples))[:, free],
            bounds=(low[free], high[free]),
            loss=loss,
            f_scale=OUTLIER,
            x_scale="jac",
            xtol=tolerance,
        ).x

    with np.errstate(over="ignore", invalid="ignore"):  # a wild trial is refused, whatever its squares
        # The robust loss is for corners that the filter cut, and the chatter of a plunger at zero. From afar, where
        # every residual is an outlier, it has valleys of its own.
        found = improve(improve(guess[free], "linear", 1e-3), "soft_l1", 1e-6)
    coordinates = whole(found)
    residuals = np.asarray(_residuals(coordinates, start, every, transform, samples))
    columns = np.asarray(_jacobian(coordinates, start, every, transform, samples))
    slope = np.asarray(transform.slope(coordinates))
    # By the loss, as residuals and columns whose squares are its own to first order.
    weight = (1 + (residuals / OUTLIER) ** 2) ** -0.25
    model = every.unpack(start, np.asarray(transform.to_physical(coordinates)))
    return model, residuals * weight, (columns / slope)[:, free] * weight[:, None]


def _reach(
    start: Float[np.ndarray, " entries"], every: Selection, samples: _Samples
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the fit begins, and how far it may go, in logarithms: not to a saturation that no lift exceeds."""
    guess, low, high = start.copy(), start - np.log(limits.FACTOR_AREAS), start + np.log(limits.FACTOR_AREAS)
    at = every.entries.index("converter.reservoir_orifice_saturation")
    deepest = float(np.log(max(-np.min(samples.lift), 1e-9)))
    if deepest > low[at]:
        high[at] = min(high[at], deepest)
        guess[at] = min(start[at], deepest + np.log(0.5))
    return guess, np.minimum(low, guess - 1.0), high


@eqx.filter_jit
def _residuals(
    coordinates: Vector, start: Actuator, every: Selection, transform: Transform, samples: _Samples
) -> Float[Array, " samples"]:
    """Rate of the pressure by the model less the measured one, in units of its noise."""
    model = every.unpack(start, transform.to_physical(coordinates))
    converter, displaced = model.converter, model.diaphragm.displaced_volume

    def one(s):
        area = jnp.where(s.lift < 0, -1.0, 1.0) * converter.orifice_area(s.lift)
        flow = flow_through(model, area, s.pressure, s.temperature, s.reservoir, s.ambient)
        gas = GasState(s.pressure, s.temperature)
        rate = model.chamber.rates(model.air, gas, flow, displaced(s.position), displaced(s.velocity)).pressure
        return (rate - s.rate) / s.rate_error

    return jax.vmap(one)(samples)


_jacobian = eqx.filter_jit(jax.jacfwd(_residuals))


def gather_entries(
    start: eqx.Module, model: eqx.Module, names: Sequence[str], errors: dict[str, float]
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
    return (
        values,
        std_errors,
        (f"not determined by these traces, so that they kept the model's values: {', '.join(held)}",),
    )


def _figure(model: Actuator, samples: _Samples) -> Curve:
    chosen = thinned(samples.count)
    lift, area = (np.asarray(signal)[: samples.count][chosen] for signal in (samples.lift, samples.area))
    grid = np.linspace(min(np.min(lift), 0.0), max(np.max(lift), 0.0), 400)
    law = np.asarray(jax.vmap(model.converter.orifice_area)(grid))
    points, line = (lift * 1e3, np.abs(area) * 1e6), (grid * 1e3, law * 1e6)
    title = "Effective flow area [2.33]: reservoir below zero, atmosphere above"
    return Curve("plunger position / mm", "effective area / mm2", points, line, title)
