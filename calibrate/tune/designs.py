"""Controllers by the names that a study gives them."""

from vgtjax import control
from vgtjax.plants import AbstractPlant

DESIGNS: dict[str, type[control.AbstractController]] = {
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
SAMPLED = ("lqg",)
"""Those that are designed for samples of one period."""


def design_for(design: str, plant: AbstractPlant, period: float) -> control.AbstractController:
    """A controller of a design for a plant, in a loop whose samples are `period` s apart."""
    sampled = {"period": period} if design in SAMPLED else {}
    return DESIGNS[design].for_plant(plant, **sampled)
