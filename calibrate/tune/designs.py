"""Controllers by the names that a study gives them."""

from vgtjax.control import (
    PI,
    PID,
    AbstractController,
    AdaptiveBackstepping,
    Backstepping,
    FrictionCompensation,
    Knocker,
)

DESIGNS: dict[str, type[AbstractController]] = {
    "pi": PI,
    "pid": PID,
    "pi-knocker": Knocker,
    "friction-compensation": FrictionCompensation,
    "backstepping": Backstepping,
    "adaptive-backstepping": AdaptiveBackstepping,
}
