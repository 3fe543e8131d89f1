"""Exhaust gas force from loops at several turbine pressures [3.16], or from a force sensor (section 3.4)."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ...estimation import LeastSquares, least_squares
from ...parts import POWERS, AbstractTabulated, AbstractVaneMap, ForcePolynomial, polynomial_terms
from ...plants import Actuator, MechanicalActuator
from ...traces import STANDARD_ATMOSPHERE, Trace, noise_level
from .. import _limits as limits
from .._filters import Samples, resting, sensor_offset, smooth
from .._result import Curve, Identified, NotPossible, bench_test, thinned

Model = Actuator | MechanicalActuator
LABELS = ("crank angle, deg", "vane force, N")


@dataclasses.dataclass(frozen=True, eq=False)
class SlowSamples:
    """Slow motion of one trace, arrays of shape `(samples,)`.

    Crank `angle` in deg, whether the vanes are `closing`, the map's `direction` from -1 to 1, `turbine` pressure in Pa
    gauge, `force` in N: the drive, or the force sensor's. `noise` is the standard deviation of one force, `common` that
    of its unknown constant.
    """

    angle: Samples
    closing: Bool[np.ndarray, " samples"]
    direction: Samples
    turbine: Samples
    force: Samples
    noise: float
    common: float

    @property
    def hot(self) -> bool:
        """Whether there is exhaust gas."""
        return bool(np.max(self.turbine, initial=0.0) > limits.NO_GAS)


@bench_test(
    "vane force map",
    "3.16",
    "Least squares over turbine pressure and crank angle of slow samples in both directions; loops without exhaust gas "
    "are the reference.",
)
def identify_vane_map(model: Model, traces: Sequence[Trace]) -> Identified:
    """Both tables of a [`HysteresisMap`][] or a [`SpeedMap`][] from slow loops [3.16, erratum], one of them without
    exhaust gas, or from a force sensor.

    **Arguments:** `model`: with the spring and the diaphragm's area; `traces`: with `x_d` in m, `p_act` in Pa or
    `f_vane` in N, and `p_trb` in Pa gauge where there is exhaust gas.

    **Returns:** `vane_force.closing` and `vane_force.opening` in N, and `vane_force.turbine_pressure` in Pa where the
    knots moved. Entries that no sample reaches keep the model's value, with NaN as standard error.
    """
    vane_force = model.vane_force
    if isinstance(vane_force, AbstractTabulated):
        raise NotPossible(
            "the model's vane force follows from a nozzle, of which no test alone tells; free e.g. "
            "vane_force.nozzle.lead in a fit"
        )
    if not isinstance(vane_force, AbstractVaneMap):
        raise NotPossible("the model has no vane-force map; choose a model with a HysteresisMap or a SpeedMap")
    sensed = any(trace.f_vane is not None for trace in traces)
    used = [samples for trace in traces for samples in _slow_samples(model, vane_force, trace, sensed)]
    if not any(samples.hot for samples in used):
        raise NotPossible("no trace moves slowly under exhaust gas; record loops with p_trb above zero")
    if not sensed and all(samples.hot for samples in used):
        raise NotPossible("no trace moves slowly without exhaust gas, the reference; record a loop at 0 mbar gauge")
    return _solve_map(_on_visited_knots(vane_force, used), vane_force, used, sensed)


def _slow_samples(model: Model, vane_force: AbstractVaneMap, trace: Trace, sensed: bool) -> list[SlowSamples]:
    """What of a trace can be used: one set of samples, or none."""
    if trace.x_d is None or (trace.f_vane is None if sensed else trace.p_act is None):
        return []
    trace, diaphragm = trace.on_one_clock(), model.diaphragm
    assert trace.x_d is not None
    noise = noise_level(trace.x_d, "x_d")
    smoothed, offset = smooth(trace.time, trace.x_d, noise), sensor_offset(model, trace, "x_d")
    position = smoothed.value - offset.value
    chosen = (np.abs(smoothed.rate) > np.maximum(limits.VANE_SLOWEST, 3 * smoothed.rate_error)) & (
        np.abs(smoothed.rate) < limits.VANE_FASTEST
    )
    margin = limits.VANE_STOP_MARGIN
    chosen &= (position > margin) & (position < float(diaphragm.travel) - margin)
    if not np.any(chosen):
        return []
    if sensed:
        assert trace.f_vane is not None
        force, deviation, common = trace.f_vane, noise_level(trace.f_vane, "f_vane"), 0.0
    else:
        assert trace.p_act is not None
        area, stiffness = float(diaphragm.area), float(diaphragm.stiffness)
        pressure = sensor_offset(model, trace, "p_act")
        force = (trace.atmosphere - trace.p_act + pressure.value) * area
        deviation = noise_level(trace.p_act, "p_act") * area
        common = float(np.hypot(pressure.std_error * area, offset.std_error * stiffness))
    turbine = np.zeros_like(trace.time) if trace.p_trb is None else trace.p_trb
    angle = np.asarray(vane_force.crank.angle(float(diaphragm.travel) - position))
    rate = smoothed.rate[chosen]
    direction = np.asarray(vane_force.steady_direction(rate))
    return [SlowSamples(angle[chosen], rate > 0, direction, turbine[chosen], force[chosen], deviation, common)]


def _on_visited_knots(vane_force: AbstractVaneMap, used: list[SlowSamples]) -> AbstractVaneMap:
    groups = _plateaus(np.concatenate([samples.turbine for samples in used]))
    means = np.array([np.round(np.mean(group), -2) for group in groups if np.mean(group) > limits.NO_GAS])
    steady = all(_stays(group) for group in groups)
    given = np.asarray(vane_force.turbine_pressure)
    if not steady or (len(given) == len(means) and np.all(np.abs(given - means) < limits.SAME_TURBINE)):
        return vane_force
    return vane_force.on_knots(jnp.asarray(means), vane_force.crank_angle)


def _plateaus(turbine: Samples) -> list[Float[np.ndarray, " _"]]:
    """Turbine pressures in Pa, sorted, between which there are gaps."""
    visited = np.sort(turbine)
    return np.split(visited, np.flatnonzero(np.diff(visited) > limits.SAME_TURBINE) + 1)


def _stays(group: Float[np.ndarray, " _"]) -> bool:
    """Whether pressures without gaps are one."""
    return bool(np.ptp(group) < 2 * limits.SAME_TURBINE)


def _count_pressures(turbine: Samples) -> int:
    """How many turbine pressures there are; one that runs from here to there counts by how far it goes."""
    groups = _plateaus(turbine)
    return sum(1 if _stays(group) else 1 + int(np.ptp(group) // limits.SAME_TURBINE) for group in groups)


def hats(knots: Float[np.ndarray, " knots"], at: Samples) -> Float[np.ndarray, "samples knots"]:
    """Weights of linear interpolation between increasing knots, held beyond them."""
    return np.stack([np.interp(at, knots, unit) for unit in np.eye(len(knots))], axis=1)


def _solve_map(moved: AbstractVaneMap, given: AbstractVaneMap, used: list[SlowSamples], sensed: bool) -> Identified:
    pressures, angles = np.asarray(moved.turbine_pressure), np.asarray(moved.crank_angle)
    size = len(pressures) * len(angles)
    solution = _solve(*_equations(pressures, angles, used, sensed))
    names = ("closing", "opening")
    values, errors = solution.values[: 2 * size].reshape(2, -1), solution.std_errors[: 2 * size].reshape(2, -1)
    errors = np.where(_reached(pressures, angles, used), errors, np.nan)
    kept = np.stack([np.asarray(moved.closing), np.asarray(moved.opening)])
    values = np.where(np.isfinite(errors), values, kept)
    limitations = tuple(
        f"nothing at {pressures[i // len(angles)] / 100:.0f} mbar and {angles[i % len(angles)]:g} deg while {name}"
        for name, row in zip(names, errors, strict=True)
        for i in np.flatnonzero(~np.isfinite(row))
    )
    knots = {} if moved is given else {"vane_force.turbine_pressure": pressures}
    return Identified(
        values={**knots, **{f"vane_force.{name}": row for name, row in zip(names, values, strict=True)}},
        std_errors={f"vane_force.{name}": row for name, row in zip(names, errors, strict=True)},
        limitations=limitations,
        figures=_figures(pressures, angles, used, solution, sensed),
        samples=sum(len(samples.angle) for samples in used),
    )


def _solve(matrix: np.ndarray, right: np.ndarray) -> LeastSquares:
    """Least squares whose errors are those of white residuals of the size that is left, at least the sensors' noise."""
    found = least_squares(matrix, right)
    return found.scaled(max(found.scale, 1.0))


def _equations(
    pressures: np.ndarray, angles: np.ndarray, used: list[SlowSamples], sensed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Rows in units of the noise: closing table, opening table, cold forces both ways, a constant for every trace."""
    rows, right = [], []
    for number, samples in enumerate(used):
        gas, cold, constant = _columns(pressures, angles, samples, number, len(used))
        rows.append(np.hstack([gas, constant] if sensed else [gas, cold, constant]) / samples.noise)
        right.append(samples.force / samples.noise)
    # What rest leaves open of a trace's offsets stays open: its constant is known to within `common`.
    commons = [max(samples.common, 1e-9) for samples in used]
    width = rows[0].shape[1] - len(used)
    rows.append(np.hstack([np.zeros((len(used), width)), np.diag(1 / np.asarray(commons))]))
    return np.vstack(rows), np.concatenate([*right, np.zeros(len(used))])


def _weights(pressures: np.ndarray, angles: np.ndarray, samples: SlowSamples) -> np.ndarray:
    """Of every entry of a table at every sample."""
    over_pressure = hats(np.concatenate([[0.0], pressures]), samples.turbine)[:, 1:]
    return (over_pressure[:, :, None] * hats(angles, samples.angle)[:, None, :]).reshape(len(samples.angle), -1)


def _reached(pressures: np.ndarray, angles: np.ndarray, used: list[SlowSamples]) -> np.ndarray:
    """Which entries of the two tables a sample of their own direction tells of; what others tell of them is noise."""
    ways = ([each.closing for each in used], [~each.closing for each in used])
    weights = [_weights(pressures, angles, each) for each in used]
    return np.stack([np.any(np.vstack(weights)[np.concatenate(way)] > 0, axis=0) for way in ways])


def _columns(
    pressures: np.ndarray, angles: np.ndarray, samples: SlowSamples, number: int, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    over_angle, table = hats(angles, samples.angle), _weights(pressures, angles, samples)
    closing, share = samples.closing[:, None], 0.5 * (1 + samples.direction[:, None])
    constant = np.zeros((len(samples.angle), count))
    constant[:, number] = 1.0
    return (
        np.hstack([share * table, (1 - share) * table]),
        np.hstack([closing * over_angle, ~closing * over_angle]),
        constant,
    )


def _figures(
    pressures: np.ndarray, angles: np.ndarray, used: list[SlowSamples], solution: LeastSquares, sensed: bool
) -> tuple[Curve, ...]:
    size = len(pressures) * len(angles)
    figures = []
    for number, samples in enumerate(used):
        if not samples.hot:
            continue
        gas, cold, constant = _columns(pressures, angles, samples, number, len(used))
        rest = constant if sensed else np.hstack([cold, constant])
        force = samples.force - rest @ solution.values[2 * size :]
        for name, way in (("closing", samples.closing), ("opening", ~samples.closing)):
            index = np.flatnonzero(way)[np.argsort(samples.angle[way])]
            index = index[thinned(len(index))]
            angle, title = samples.angle[index], f"Force of the exhaust gas while {name}"
            points, line = (angle, force[index]), (angle, (gas @ solution.values[: 2 * size])[index])
            figures.append(Curve(*LABELS, points, line, title, f"{np.mean(samples.turbine) / 100:.0f} mbar"))
    return tuple(figures)


def _true_position(model: Model, trace: Trace) -> Samples:
    """Position in m without the sensor's offset; at rest the measured force presses the rod into its stop."""
    assert trace.x_d is not None
    assert trace.f_vane is not None
    rest = resting(model, trace)
    pressed = float(np.mean(trace.f_vane[rest])) if np.any(rest) else 0.0
    into_stop = pressed / float(model.diaphragm.stiffness + model.diaphragm.stop_stiffness)
    return trace.x_d - sensor_offset(model, trace, "x_d").value - into_stop


@bench_test("vane force polynomial", "3.15", "Least squares of the force sensor over crank angle and pressure ratio.")
def identify_vane_polynomial(model: Model, traces: Sequence[Trace]) -> Identified:
    """Coefficients of [`ForcePolynomial`][] from a force sensor: a surface fit over crank angle and ratio [3.15].

    Powers of the ratio that the turbine pressures of the traces don't determine are zero, without an error.

    **Arguments:** `traces`: with `f_vane` in N, `x_d` in m, and `p_trb` in Pa gauge where there is exhaust gas.

    **Returns:** `vane_force.coefficients` in the units of the table, in the order of `POWERS`.
    """
    vane_force = model.vane_force
    if not isinstance(vane_force, ForcePolynomial):
        raise NotPossible("the model has no polynomial; choose a model with a ForcePolynomial")
    sensed = [trace.on_one_clock() for trace in traces if trace.f_vane is not None and trace.x_d is not None]
    if not sensed:
        raise NotPossible("no trace has a force sensor; record f_vane and x_d")
    travel = float(model.diaphragm.travel)
    position = np.concatenate([_true_position(model, trace) for trace in sensed])
    angle = np.asarray(vane_force.crank.angle(travel - position))
    turbine = np.concatenate([np.zeros_like(t.time) if t.p_trb is None else t.p_trb for t in sensed])
    shift = np.concatenate([np.full_like(t.time, t.atmosphere - STANDARD_ATMOSPHERE) for t in sensed])
    force = np.concatenate([np.asarray(trace.f_vane) for trace in sensed])
    distinct = _count_pressures(turbine)
    used = np.array([power < distinct for _, power in POWERS])
    ratio = np.asarray(vane_force.ratio(turbine, float(vane_force.ambient_pressure) + shift))
    terms = np.stack(np.broadcast_arrays(*polynomial_terms(angle, ratio)), axis=1)
    noise = noise_level(force, "f_vane")
    solution = _solve(terms[:, used] / noise, force / noise)
    values, errors = np.zeros(len(POWERS)), np.full(len(POWERS), np.nan)
    values[used], errors[used] = solution.values, solution.std_errors
    sentence = f"{distinct} turbine pressures do not determine powers of the ratio above {distinct - 1}; those are zero"
    order = np.argsort(angle)[thinned(len(angle))]
    points, line = (angle[order], force[order]), (angle[order], (terms @ values)[order])
    return Identified(
        values={"vane_force.coefficients": values},
        std_errors={"vane_force.coefficients": errors},
        limitations=() if np.all(used) else (sentence,),
        figures=(Curve(*LABELS, points, line, "Force sensor and surface"),),
        samples=len(angle),
    )
