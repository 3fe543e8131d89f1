"""The static magnetic force from equilibria of the plunger [2.8-2.9]."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...estimation import LeastSquares, huber_weights, least_squares
from ...parameters import parameter_table
from ...plants import Actuator
from ...traces import SENSOR_PRESSURE_OFFSET, Trace, robust_deviation
from .. import _limits as limits
from .._result import Curve, Identified, NotPossible, bench_test
from ._chamber_flow import NEEDS, ChamberRecord, read_chamber, usable, without_position
from ._equilibria import Equilibrium, find_equilibria


@bench_test("magnetic force", "2.8, 2.9", "Weighted least squares of the force on a closed plunger at equilibria.")
def identify_magnetic_force(model: Actuator, traces: Sequence[Trace]) -> Identified:
    """Magnetic force as a quartic in the duty, from the balance of pressures on a closed plunger [2.8, 2.9].

    Where the equilibria don't carry a quartic, the model's own is adjusted, and has no standard errors.

    **Arguments:** `model`: with start values; `traces`: with `pwm` in %, `p_act` in Pa, and best `x_d` in m.

    **Returns:** `converter.magnetic_force`, `c0..c4` in N/%^n, of shape `(5,)`. A model with a coil gets only the
    picture.
    """
    records = [read_chamber(model, trace) for trace in usable(traces)]
    points = [point for i, record in enumerate(records) for point in find_equilibria(model, record, i)]
    if not points:
        raise NotPossible(
            "no equilibrium with the chamber between reservoir and atmosphere was found: hold the duty until the "
            f"pressure stands still, or ramp it slowly ({NEEDS})"
        )
    solution = _solve(model, points, records)
    errors = np.sqrt(np.diag(solution.covariance)) if solution.form == "quartic" else np.full(5, np.nan)
    coil = "converter.magnetic_force" not in parameter_table(model)
    duties = np.array([point.duty for point in points])
    return Identified(
        method=f"{len(points)} equilibria of {len(records)} traces; {_FORMS[solution.form]} by weighted least squares",
        values={} if coil else {"converter.magnetic_force": solution.coefficients},
        std_errors={} if coil else {"converter.magnetic_force": errors},
        limitations=(*_limitations(solution, duties, coil), *_unknown_offsets(records), *without_position(traces)),
        figures=(_figure(solution, duties),),
        samples=len(points),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class _ForceFit:
    """`coefficients` of the quartic and their covariance; `forces` are the measured ones without lift and offset."""

    form: str
    coefficients: Float[np.ndarray, " 5"]
    covariance: Float[np.ndarray, "5 5"]
    forces: Float[np.ndarray, " points"]


_FORMS = {
    "quartic": "a quartic in the duty, the lift and the offsets",
    "scale and bend": "a scale and a square-law correction of the model's quartic, the lift and the offsets",
    "scale": "a scale of the model's quartic, the lift and the offsets",
}


def _solve(model: Actuator, points: list[Equilibrium], records: list[ChamberRecord]) -> _ForceFit:
    """The richest form that the equilibria carry over the whole range of duties."""
    known = _model_quartic(model)
    full = float(np.sum(known * 100.0 ** np.arange(5)))
    bases = {"quartic": np.eye(5), "scale and bend": np.stack([known, np.eye(5)[2]], axis=1), "scale": known[:, None]}
    grid = np.linspace(0, 100, 101)[:, None] ** np.arange(5)
    for form, basis in bases.items():
        solution = _regress(model, points, records, form, basis)
        if form == "scale" or len(_distinct(points)) >= basis.shape[1]:
            band = np.sqrt(np.sum((grid @ solution.covariance) * grid, axis=1))
            if form == "scale" or np.max(band) < limits.ERROR_PULL * abs(full):
                break
    return solution


def _model_quartic(model: Actuator) -> Float[np.ndarray, " 5"]:
    """The model's static force, or the quartic through a coil's."""
    duty = np.linspace(0, 100, 41)
    pull = np.asarray(model.converter.magnetic_force.steady_pull(duty, np.zeros_like(duty)))
    return least_squares(duty[:, None] ** np.arange(5), pull).values


def _distinct(points: list[Equilibrium]) -> list[float]:
    duties = sorted(point.duty for point in points)
    return [duty for i, duty in enumerate(duties) if i == 0 or duty - duties[i - 1] > limits.SAME_DUTY]


def _regress(
    model: Actuator, points: list[Equilibrium], records: list[ChamberRecord], form: str, basis: np.ndarray
) -> _ForceFit:
    """Weighted least squares for the coefficients in `basis`, the lift's force an area, and the offsets."""
    lift = float(model.converter.membrane_stiffness / model.converter.reservoir_orifice_slope)
    powers, area = np.stack([point.powers for point in points]), np.array([point.area for point in points])
    force = np.array([point.force for point in points])
    noise = np.hypot([point.error for point in points], lift * np.array([point.area_error for point in points]))
    owner = np.array([point.trace for point in points])
    offsets = float(model.converter.actuator_area) * np.eye(len(records))[owner]
    # The model's lift is an observation like others, so that equilibria without flow don't leave it undetermined.
    # So is its pull without duty, which no equilibrium shows.
    count, idle = basis.shape[1], float(_model_quartic(model)[0])
    prior = np.zeros((2 + len(records), count + 1 + len(records)))
    prior[0, count] = 1 / (limits.LIFT_FORCE_ERROR * lift)
    prior[1, :count] = basis[0] / limits.IDLE_PULL_ERROR
    for i, record in enumerate(records):
        trust = record.offset.std_error if record.offset.known else SENSOR_PRESSURE_OFFSET
        prior[2 + i, count + 1 + i] = 1 / trust
    expected = np.array([1 / limits.LIFT_FORCE_ERROR, idle / limits.IDLE_PULL_ERROR, *np.zeros(len(records))])
    columns = np.concatenate([powers @ basis, area[:, None], -offsets], axis=1) / noise[:, None]
    found = _robust(columns, force / noise, prior, expected)
    answer = found.values
    return _ForceFit(
        form,
        basis @ answer[:count],
        basis @ found.covariance[:count, :count] @ basis.T,
        force - area * answer[count] + offsets @ answer[count + 1 :],
    )


def _robust(columns: np.ndarray, target: np.ndarray, prior: np.ndarray, expected: np.ndarray) -> LeastSquares:
    """Solution of `columns x = target`, with `prior x = expected` beside it, all in units of noise.

    Huber's weights: an equilibrium that had not settled must not bend the curve. Where the scatter is more than the
    noise explains, it counts.
    """
    rows, weights, scale = len(target), np.ones(len(target)), 1.0
    for _ in range(REWEIGHTINGS):
        system = np.concatenate([columns * weights[:, None] / scale, prior])
        found = least_squares(system, np.concatenate([target * weights / scale, expected]))
        left = target - columns @ found.values
        freedom = max(rows - np.sum(np.abs(prior).max(axis=0) == 0) - 1, 1)
        scale = max(1.0, np.sqrt(np.sum((weights * left) ** 2) / freedom))
        weights = huber_weights(left, max(1.0, robust_deviation(left)))
    return found


REWEIGHTINGS = 10
"""Enough for three digits of the weights."""


def _limitations(solution: _ForceFit, duties: Float[np.ndarray, " points"], coil: bool) -> tuple[str, ...]:
    span = f"{np.min(duties):.0f} to {np.max(duties):.0f} %"
    sentences = [
        f"equilibria were found at {span} duty; outside, and below the duty that closes the plunger, the curve is "
        "extrapolated"
    ]
    if solution.form != "quartic":
        sentences.append(
            f"equilibria at {len(np.unique(np.round(duties)))} duties don't carry a quartic, so the model's was only "
            f"adjusted ({solution.form}) and its coefficients have no standard errors: add holds at other duties"
        )
    if coil:
        sentences.append("the model has a coil in place of the quartic: compare the curve, or fit the coil")
    return tuple(sentences)


def _unknown_offsets(records: list[ChamberRecord]) -> tuple[str, ...]:
    names = [record.trace.name for record in records if not record.offset.known]
    if not names:
        return ()
    return (f"{', '.join(names)} did not begin at rest, so the offset of the pressure sensor is only known to 50 mbar",)


def _figure(solution: _ForceFit, duties: Float[np.ndarray, " points"]) -> Curve:
    grid = np.linspace(0, 100, 201)
    curve = np.polynomial.polynomial.polyval(grid, solution.coefficients)
    return Curve("duty / %", "magnetic force / N", (duties, solution.forces), (grid, curve), "Magnetic force [2.9]")
