"""Smooth and switching observers of pressure behind linear and switching differentiators, in the same closed loop."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

import vgtjax
from vgtjax import control
from vgtjax.control import AbstractDifferentiator, Backstepping, ImplicitLevantDifferentiator, LevantDifferentiator

from ..table import Section

EXPONENT = 1.3
"""Of the design model: air of the full actuator keeps most of its heat."""
SETTLED, END = 2.0, 14.0
"""s; Signal 1 in between."""
GAINS: dict[str, dict[str, Any]] = {
    "`alpha2` 1400": {"injection_rate": 1400.0, "switching_gain": 0.0},
    "`K2` 30": {"injection_rate": 0.0, "switching_gain": 30.0},
    "`K2` 60": {"injection_rate": 0.0, "switching_gain": 60.0},
}
DIFFERENTIATORS: dict[str, AbstractDifferentiator] = {
    "explicit, `L` 1, 2 mm": LevantDifferentiator(1.0, 2e-3),
    "explicit, `L` 1, 30 um": LevantDifferentiator(1.0, 3e-5),
    **{f"implicit, `L` {slope:g}": ImplicitLevantDifferentiator(slope) for slope in (0.01, 0.05, 0.5)},
}


def measure() -> Section:
    """Closes the loop with each pair of both."""
    section = Section(
        "Smooth and switching observers of pressure",
        f"The full printed actuator with the sensors of a bench, `Backstepping` that knows it (exponent {EXPONENT:g}), "
        f"along Signal 1 from {SETTLED:g} to {END:g} s.",
        ("differentiator", "observer", "RMS um", "peak", "pressure RMS Pa", "peak Pa", "chatter %"),
    )
    actuator = vgtjax.Actuator()
    model = dataclasses.replace(control.DesignModel.for_plant(actuator), exponent=jnp.asarray(EXPONENT))
    believes = Backstepping.for_plant(actuator, model)
    for differentiator, slope in DIFFERENTIATORS.items():
        for observer, gains in GAINS.items():
            chosen = dataclasses.replace(
                believes, observer=dataclasses.replace(believes.observer, **gains), differentiator=slope
            )
            section.add(differentiator, observer, *(f"{value:.3g}" for value in _figures(actuator, chosen)))
    return section


@eqx.filter_jit
def _figures(actuator: vgtjax.Actuator, controller: Backstepping) -> tuple[jax.Array, ...]:
    scenario = control.Scenario(control.signal_1(), sensors=control.Sensors.bench(), key=jax.random.key(0))
    run = control.close_loop(actuator, controller, scenario, END)
    unseen = jnp.where(run.time >= SETTLED, run.pressure - run.log["pressure"], 0.0)
    return (
        1e6 * control.tracking_rms(run, SETTLED),
        1e6 * control.tracking_peak(run, SETTLED),
        control.pressure_rms(run, SETTLED),
        jnp.max(jnp.abs(unseen)),
        control.chatter(run, SETTLED),
    )
