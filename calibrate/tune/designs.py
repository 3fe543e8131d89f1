"""Controllers by the names that a study gives them."""

from vgtjax import control

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
