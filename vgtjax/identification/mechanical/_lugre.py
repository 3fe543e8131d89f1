"""LuGre friction from sliding, break-away and turns [3.8-3.12]."""

import contextlib
from collections.abc import Sequence

import numpy as np

from ...parameters import parameter_table, replace_parameters
from ...plants import AbstractModel, MechanicalActuator
from ...traces import Trace
from .. import _limits as limits
from .._result import Curve, Identified, NotPossible, bench_test, thinned
from ._bristles import Bristles, fit_bristles, read_paths
from ._dahl import friction_over_position
from ._mechanical_fit import ResponseFit, fit_response
from ._motion import MotionRecord, dry_friction, mechanical_half, read_motions, sliding_law
from ._second_order import start_from_motion
from ._sliding import fit_sliding


@bench_test(
    "LuGre friction",
    "3.8-3.12",
    "Regression of friction over velocity where the rod slides, then over its path, then nonlinear least squares "
    "of the position that follows from the drive.",
)
def identify_lugre(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """All parameters of LuGre friction [3.8-3.12].

    **Arguments:** `model`: with start values; `traces`: with `x_d` in m, and `p_act` in Pa or `f_drive` in N.

    **Returns:** every `friction` parameter that the traces determine, in the units of the table and of shape `()`; the
    others, for instance `sigma_1` from slow loops, are in `limitations`.
    """
    half, motions = mechanical_half(model), read_motions(model, traces)
    law = dry_friction(half)
    if law.stribeck_velocity is None or law.bristle_damping is None:
        raise NotPossible("the model's friction is not LuGre's; choose a model with LuGre friction")
    start, bristles = start_from_motion(half, motions), None
    with contextlib.suppress(NotPossible):
        bristles = fit_bristles(half, read_paths(half, motions), stribeck=True)
        start = start_from_bristles(start, bristles)
    response = fit_response(half, motions, start)
    mine = [entry for entry in response.calibration.task.selection.entries if entry.startswith("friction.")]
    return response.report(mine, figures=_figures(response, motions, bristles))


def start_from_bristles(half: MechanicalActuator, found: Bristles) -> MechanicalActuator:
    """`half` with what the paths determine of its friction."""

    def determined(*names: str) -> bool:
        return all(found.relative_error(name) < limits.ERROR_START and found.values[name] > 0 for name in names)

    old, table, new = dry_friction(half), parameter_table(half), dict[str, float]()
    assert old.bristle_damping is not None
    coulomb = float(old.coulomb_force)
    if determined("coulomb"):
        new["coulomb_force"] = coulomb = found.values["coulomb"]
        new["static_force"] = coulomb * float(old.stiction)
    if determined("coulomb", "deflection"):
        new["bristle_stiffness"] = coulomb / found.values["deflection"]
    if determined("ratio", "stribeck"):
        new["static_force"] = coulomb * found.values["ratio"]
        new["stribeck_velocity"] = found.values["stribeck"]
    for name, term in (("bristle_damping", "bristle_damping"), ("viscous_damping", "viscous")):
        if determined(term):
            new[name] = found.values[term]
    if "friction.stribeck_drop" in table:  # in parameters of its own
        damping = new.get("bristle_damping", float(old.bristle_damping))
        drop = max(new.get("static_force", float(old.static_force)) - coulomb, 0.0)
        new["stribeck_drop"] = drop
        viscous = new.get("viscous_damping", float(old.viscous_damping))
        new["excess_damping"] = max(viscous - damping * drop / coulomb, 0.0)
    named = {f"friction.{name}": value for name, value in new.items()}
    return replace_parameters(half, {name: value for name, value in named.items() if name in table})


def _figures(response: ResponseFit, motions: Sequence[MotionRecord], bristles: Bristles | None) -> tuple[Curve, ...]:
    fitted, figures = dry_friction(response.model).stribeck_velocity, []
    assert fitted is not None
    with contextlib.suppress(NotPossible):
        sliding = fit_sliding(response.model, motions, float(fitted))
        chosen = thinned(len(sliding.force))
        speed = np.linspace(np.min(sliding.velocity), np.max(sliding.velocity), 401)
        points = (1e3 * sliding.velocity[chosen], sliding.friction()[chosen])
        line = (1e3 * speed, sliding_law(response.model, speed))
        figures.append(Curve("velocity, mm/s", "friction, N", points, line, "friction over velocity"))
    if bristles is not None:
        figures.append(friction_over_position(bristles))
    return tuple(figures)
