"""What the position tells an observer of the load, window by window along Signals 1 and 2."""

import dataclasses

import jax
import numpy as np

import vgtjax
from vgtjax import control

from ..table import Section

WINDOW = 0.5
"""s"""
NARROW = 10.0
"""Pa to either side, over which the flow map has the slope of the pressure itself: none where both seats are shut."""
STOP = control.Sine(0.0, 6.0, 0.0)
"""A reference that lies on the open stop."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a window begins along a reference, in seconds."""

    name: str
    reference: control.AbstractSignal
    begin: float


PLACES = (
    Place("Signal 1, rising", control.signal_1(), 2.5),
    Place("Signal 1, turning at the top", control.signal_1(), 12.5),
    Place("Signal 1, where friction changes sides", control.signal_1(), 15.0),
    Place("Signal 1, falling", control.signal_1(), 30.0),
    Place("Signal 2, a second after it, at rest", control.signal_2(), 4.5),
    Place("on the open stop", STOP, 1.0),
)


def measure() -> Section:
    """Runs the closed loops on the printed actuator, with noise."""
    section = Section(
        "What the position tells",
        f"Singular values of the observability matrix of `LoadObserver` over windows of {WINDOW:g} s, in units of what "
        "is known beforehand: closed loops of the printed actuator with the sensors of a bench. A direction near one "
        "or below is told no better than it was known. The flow map's slope is the observer's, over 1 kPa to either "
        f"side; the last column has the least of the values with the slope over {NARROW:g} Pa.",
        ("window", "begins at s", "rod at mm", "singular values", "least, narrow slope"),
    )
    actuator = vgtjax.Actuator()
    controller = control.LoadBackstepping.for_plant(actuator)
    for place in PLACES:
        scenario = control.Scenario(place.reference, sensors=control.Sensors.bench(), key=jax.random.key(0))
        run = control.close_loop(actuator, controller, scenario, place.begin + WINDOW)
        samples = round(1e3 * WINDOW)
        values = np.asarray(control.observability(controller, run, samples))[-1]
        narrow = np.asarray(control.observability(controller, run, samples, secant=NARROW))[-1]
        section.add(
            place.name,
            f"{place.begin:g}",
            f"{round(1e3 * float(run.position[-1]), 1) + 0.0:.1f}",
            ", ".join(f"{each:.3g}" for each in values),
            f"{narrow[-1]:.3g}",
        )
    return section
