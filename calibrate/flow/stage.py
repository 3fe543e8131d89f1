"""The turbine that a study has, and the rod that its force acts on."""

import vgtjax
from vgtjax.parts import Stage
from vgtjax.plants import Rod

from ..study.components import TURBINES
from ..study.models import build_model, start_model
from ..study.places import StudyError, of_study
from ..study.tables import Study


def parts_of(study: Study) -> tuple[vgtjax.Turbine, Rod]:
    """The turbine of a study, and the rod that its force acts on, with the values that they start from.

    **Raises:** `InputError` when its vane force is no turbine, or one that does not work.
    """
    name = study.components.vane_force
    if name not in TURBINES:
        raise StudyError(
            f"flow needs vane_force = 'turbine', but it is '{name}'; change it under [components], or "
            "leave the study out"
        )
    with of_study():
        model = start_model(build_model(study), study, {})[0]
    return model.vane_force, model.rod


def turbine_of(stage: Stage) -> vgtjax.Turbine:
    """The vane force of a stage that no study has.

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
