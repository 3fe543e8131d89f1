"""The turbine that a study has."""

import vgtjax
from vgtjax import InputError
from vgtjax.parts import Stage

from ..study.components import TURBINES
from ..study.models import build_model, start_model
from ..study.tables import Study


def stage_of(study: Study) -> Stage:
    """The stage of a study, with the values that it starts from.

    **Raises:** `InputError` when its vane force is no turbine, or one that does not work.
    """
    name = study.components.vane_force
    if name not in TURBINES:
        raise InputError(
            f"flow needs vane_force = 'turbine', but it is '{name}'; change it under [components], or "
            "leave the study out"
        )
    vane_force: vgtjax.Turbine = start_model(build_model(study), study, {})[0].vane_force
    return vane_force.stage
