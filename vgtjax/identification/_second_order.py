"""Mass and damping of the diaphragm from its response [2.37, 2.38]."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..parameters import parameter_table, replace_parameters
from ..plants import AbstractModel, MechanicalActuator
from ..traces import Trace
from ._axis_regression import regress_axis
from ._mechanical_fit import Response, candidates, fit_response, response_figures, untold
from ._motion import Motion, mechanical_half, plain_friction, read_motions
from ._result import Identified
from ._weak_form import Sliding, fit_sliding

REPORTED = ("diaphragm.mass", "friction.viscous_damping", "friction.excess_damping")


def identify_mass_and_damping(model: AbstractModel, traces: Sequence[Trace]) -> Identified:
    """Mass and damping from the response of `x_d` to the measured drive [2.37, 2.38].

    The input is `p_atm - p_act - F_0 / A_d` (erratum 10), and friction acts as it does on the bench, where the print
    leaves it out. A regression of the drive over acceleration and velocity is the start of a nonlinear least squares
    of the simulated position. The other parameters of diaphragm and friction are unknowns of it as well, or their
    errors would be in mass and damping; what it finds for them, their own tests report. Of `b_d` and `sigma_2` only
    the sum acts (erratum 11): the damping is what goes to `friction.viscous_damping`.

    **Arguments:** `model`: with start values, and spring and preload found before; `traces`: with `x_d` in m, and
    `p_act` in Pa or `f_drive` in N.

    **Returns:** `diaphragm.mass` in kg and `friction.viscous_damping` in N s/m (`friction.excess_damping` of
    [`PassiveLuGre`][]), of shape `()`; natural frequency and damping ratio [2.38] in `method`.
    """
    result = Identified(
        "mass and damping",
        "2.37, 2.38",
        "Regression of the drive over acceleration and velocity, then nonlinear least squares of the position that "
        "follows from the drive, with spring and friction as further unknowns.",
    )
    motions = read_motions(model, traces)
    half = mechanical_half(model)
    response = fit_response(half, motions, start_from_motion(half, motions))
    if isinstance(response, str):
        return dataclasses.replace(result, unseen=(response,))
    known = [name for name in REPORTED if name in parameter_table(half)]
    return dataclasses.replace(
        result,
        method=f"{result.method}{_oscillator(response)}",
        values={name: response.values[name] for name in known if name in response.values},
        std_errors={name: response.std_errors[name] for name in known if name in response.values},
        unseen=tuple(untold(name) for name in known if name in response.untold),
        figures=response_figures(response),
        samples=response.calibration.count,
    )


def _oscillator(response: Response) -> str:
    """Natural frequency and damping ratio [2.38] as a sentence, or nothing where they are not told."""
    if any(name in response.untold for name in REPORTED):
        return ""
    diaphragm: Any = response.model.diaphragm
    damping = float(diaphragm.damping) + float(plain_friction(response.model).viscous_damping)
    mass, stiffness = float(diaphragm.mass), float(diaphragm.stiffness)
    if stiffness == 0:
        return f" Without a spring, the velocity settles in {mass / damping:.3g} s."
    frequency, ratio = np.sqrt(stiffness / mass), damping / (2 * np.sqrt(stiffness * mass))
    return f" Natural frequency {frequency:.4g} rad/s, damping ratio {ratio:.3g}."


def start_from_motion(half: MechanicalActuator, motions: Sequence[Motion]) -> MechanicalActuator:
    """`half` with what regressions tell of mass, spring and friction.

    An axis that a force drives turns round more than it slides: it has a regression of its own.
    """
    if any(motion.trace.f_drive is not None for motion in motions):
        told = regress_axis(half, motions, candidates(half))
        return half if isinstance(told, str) else replace_parameters(half, told)
    found = fit_sliding(half, motions)
    return half if isinstance(found, str) else _with_law(half, found)


def _with_law(half: MechanicalActuator, found: Sliding) -> MechanicalActuator:
    """`half` with those values of the law of the sliding rod that are physical and better than a guess."""
    places = {
        "diaphragm.preload": "preload",
        "diaphragm.stiffness": "stiffness",
        "diaphragm.mass": "mass",
        "friction.viscous_damping": "viscous",
        "friction.coulomb_force": "coulomb",
    }
    table, values = parameter_table(half), {}
    for name, term in places.items():
        value, error = found.values.get(term, np.nan), found.std_errors.get(term, np.nan)
        told = np.isfinite(error) and error < 0.5 * abs(value)
        if name in table and told and (value > 0 or not table[name].positive):
            values[name] = value
    if "friction.coulomb_force" in values and "friction.static_force" in table:
        # Stiction keeps its proportion until it is found itself.
        friction: Any = half.friction
        ratio = float(friction.static_force / friction.coulomb_force)
        values["friction.static_force"] = ratio * values["friction.coulomb_force"]
    return replace_parameters(half, values)
