"""Controllers by the names that a study gives them."""

from vgtjax import control
from vgtjax.plants import AbstractPlant

from ..study.control import Design

DESIGNS: dict[Design, type[control.AbstractController]] = {
    "pi": control.PI,
    "pid": control.PID,
    "pi-knocker": control.Knocker,
    "scheduled-pi": control.ScheduledPI,
    "adrc": control.ADRC,
    "lqg": control.LQG,
    "friction-compensation": control.FrictionCompensation,
    "backstepping": control.Backstepping,
    "adaptive-backstepping": control.AdaptiveBackstepping,
    "adaptive-position": control.LoadBackstepping,
}


def design_for(design: Design, plant: AbstractPlant, period: float) -> control.AbstractController:
    """A controller of a design for a plant, in a loop whose samples are `period` s apart."""
    kind = DESIGNS[design]
    return kind.for_plant(plant, **({"period": period} if kind.sampled else {}))
