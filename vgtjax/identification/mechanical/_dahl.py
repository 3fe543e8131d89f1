"""Dahl friction from friction over position [3.3.2.2]."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...parameters import parameter_table
from ...plants import AbstractModel, MechanicalActuator
from ...traces import Trace
from .. import _limits as limits
from .._result import Curve, Identified, bench_test, thinned
from ._bristles import Bristles, fit_bristles, read_paths
from ._motion import dry_friction, mechanical_half, read_motions


@bench_test(
    "Dahl friction",
    "3.5, section 3.3.2.2",
    "Least squares of the drive over position, velocity, acceleration and the force of bristles along the path.",
)
def identify_dahl(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Coulomb force and stiffness of the bristles from friction over position [3.5, section 3.3.2.2].

    **Arguments:** `model`: with start values; `traces`: with `x_d` in m, and `p_act` in Pa or `f_drive` in N.

    **Returns:** `friction.coulomb_force` in N and, for friction with bristles, `friction.bristle_stiffness` in N/m, of
    shape `()`.
    """
    half = mechanical_half(model)
    found = fit_bristles(half, read_paths(half, read_motions(model, traces)), stribeck=False)
    values: dict[str, Any] = {}
    errors: dict[str, Any] = {}
    limitations = []
    coulomb, deflection = found.values["coulomb"], found.values["deflection"]
    uncertain = float(np.hypot(found.relative_error("coulomb"), _stiction(half) / abs(coulomb)))
    if uncertain < limits.ERROR and coulomb > 0:
        values["friction.coulomb_force"] = np.asarray(coulomb)
        errors["friction.coulomb_force"] = np.asarray(uncertain * coulomb)
    else:
        limitations.append(f"friction.coulomb_force: {_why_no_level(found, half)}")
    if "friction.bristle_stiffness" in parameter_table(half):
        error = float(np.hypot(uncertain, found.relative_error("deflection")))
        if error < limits.ERROR and coulomb > 0:
            values["friction.bristle_stiffness"] = np.asarray(coulomb / deflection)
            errors["friction.bristle_stiffness"] = np.asarray(error * coulomb / deflection)
        else:
            limitations.append(
                "friction.bristle_stiffness: the rod does not turn round often enough within its travel; record turns"
            )
    return Identified(
        values=values,
        std_errors=errors,
        limitations=tuple(limitations),
        figures=(friction_over_position(found),),
        samples=found.samples,
    )


def _why_no_level(found: Bristles, half: MechanicalActuator) -> str:
    """What to do about a level of friction that is not determined."""
    level = found.values["coulomb"]
    if level <= 0 or not found.relative_error("coulomb") < limits.ERROR:
        return "the rod does not slide both ways; record it moving out and back"
    return (
        f"Dahl's law has one level, here {level:.3g} N, where the model has a static force that is "
        f"{2 * _stiction(half):.3g} N above it; identify friction that has both"
    )


def _stiction(half: MechanicalActuator) -> float:
    """What Dahl's law leaves open in N where friction has stiction: its level is between `F_c` and `F_s`."""
    friction = dry_friction(half)
    return 0.5 * abs(float(friction.static_force - friction.coulomb_force))


def friction_over_position(found: Bristles) -> Curve:
    """Friction without its viscous part over position, measured and by the law."""
    chosen = thinned(len(found.law))
    position = 1e3 * found.position[chosen]
    points, line = (position, found.measured[chosen]), (position, found.law[chosen])
    return Curve("position, mm", "friction, N", points, line, "friction over position")
