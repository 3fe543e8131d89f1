"""Mass and damping of the diaphragm from its response [2.37, 2.38]."""

from collections.abc import Sequence

import numpy as np

from ...parameters import parameter_table, replace_parameters
from ...plants import AbstractModel, MechanicalActuator
from ...traces import Trace
from .. import _limits as limits
from .._result import Identified, NotPossible, bench_test
from ._axis_regression import regress_axis
from ._mechanical_fit import ResponseFit, candidates, fit_response
from ._motion import MotionRecord, mechanical_half, read_motions
from ._sliding import Sliding, fit_sliding

METHOD = (
    "Regression of the drive over acceleration and velocity, then nonlinear least squares of the position that "
    "follows from the drive, with spring and friction as further unknowns."
)
REPORTED = ("diaphragm.mass", "friction.viscous_damping", "friction.excess_damping")


@bench_test("mass and damping", "2.37, 2.38", METHOD)
def identify_mass_and_damping(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Mass and damping from the response of `x_d` to the measured drive [2.37, 2.38, errata].

    **Arguments:** `model`: with start values, and spring and preload found before; `traces`: with `x_d` in m, and
    `p_act` in Pa or `f_drive` in N.

    **Returns:** `diaphragm.mass` in kg and `friction.viscous_damping` in N s/m (`friction.excess_damping` of
    [`PassiveLuGre`][]), of shape `()`; natural frequency and damping ratio [2.38] in `method`.
    """
    half, motions = mechanical_half(model), read_motions(model, traces)
    response = fit_response(half, motions, start_from_motion(half, motions))
    return response.report(REPORTED, method=f"{METHOD}{_oscillator(response)}")


def _oscillator(response: ResponseFit) -> str:
    """Natural frequency and damping ratio [2.38] as a sentence, or nothing where they are not determined."""
    diaphragm, friction = response.model.diaphragm, response.model.friction.dry()
    if friction is None or any(name in response.not_determined for name in REPORTED):
        return ""
    damping = float(diaphragm.damping) + float(friction.viscous_damping)
    mass, stiffness = float(diaphragm.mass), float(diaphragm.stiffness)
    if stiffness == 0:
        return f" Without a spring, the velocity settles in {mass / damping:.3g} s."
    frequency, ratio = np.sqrt(stiffness / mass), damping / (2 * np.sqrt(stiffness * mass))
    return f" Natural frequency {frequency:.4g} rad/s, damping ratio {ratio:.3g}."


def start_from_motion(half: MechanicalActuator, motions: Sequence[MotionRecord]) -> MechanicalActuator:
    """`half` with what regressions determine of mass, spring and friction.

    An axis that a force drives turns round more than it slides: it has a regression of its own.
    """
    try:
        if any(motion.trace.f_drive is not None for motion in motions):
            return replace_parameters(half, regress_axis(half, motions, candidates(half)))
        return _with_law(half, fit_sliding(half, motions))
    except NotPossible:
        return half


def _with_law(half: MechanicalActuator, found: Sliding) -> MechanicalActuator:
    """`half` with those values of the law of the sliding rod that are physical and better than a guess."""
    places = {
        "diaphragm.preload": "preload",
        "diaphragm.stiffness": "stiffness",
        "diaphragm.mass": "mass",
        "friction.viscous_damping": "viscous",
        "friction.coulomb_force": "coulomb",
    }
    table, values, friction = parameter_table(half), {}, half.friction.dry()
    for name, term in places.items():
        determined = found.relative_error(term) < limits.ERROR_START
        if name in table and determined and (found.values[term] > 0 or not table[name].positive):
            values[name] = found.values[term]
    if friction is not None and "friction.coulomb_force" in values and "friction.static_force" in table:
        # Stiction keeps its proportion until it is found itself.
        values["friction.static_force"] = float(friction.stiction) * values["friction.coulomb_force"]
    return replace_parameters(half, values)
