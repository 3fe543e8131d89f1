"""The turbine that a study has, as a stage and as a vane force."""

import vgtjax
from vgtjax.parts import Stage

from ..study.components import TURBINES
from ..study.models import build_model, start_model
from ..study.places import StudyError, of_study
from ..study.tables import Study


def stage_of(study: Study) -> Stage:
    """The stage of a study, with the values that it starts from.

    **Raises:** `InputError` when its vane force is no turbine, or one that does not work.
    """
    name = study.components.vane_force
    if name not in TURBINES:
        raise StudyError(
            f"flow needs vane_force = 'turbine', but it is '{name}'; change it under [components], or "
            "leave the study out"
        )
    with of_study():
        vane_force: vgtjax.Turbine = start_model(build_model(study), study, {})[0].vane_force
    return vane_force.stage


def turbine_of(stage: Stage) -> vgtjax.Turbine:
    """The vane force of a stage; that of a study's has its table already.

    **Raises:** `SimulationError` that names the point at which no steady state is found.
    """
    return vgtjax.Turbine(
        stage.nozzle,
        stage.linkage,
        stage.gas,
        stage.total_temperature,
        stage.outlet_pressure,
        stage.speed_ratio,
        crank=stage.crank,
        wheel_speed=stage.wheel_speed,
    )
