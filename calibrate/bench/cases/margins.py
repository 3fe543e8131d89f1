"""What the linearised closed loop of each design bears, on the plant that it believes in."""

import vgtjax
from vgtjax import control
from vgtjax.tuning import cross_cases, sliding_margins

from ...tune.designs import DESIGNS
from ..table import Section


def measure() -> Section:
    """Linearises the loop of each design, with its default gains."""
    section = Section(
        "Margins of closed loops",
        "Each design with default gains on the printed actuator, which it knows, in the middle of the travel along a "
        "slow sine, without noise. Up to its margins the loop stays stable.",
        ("design", "rod", "times its gain", "phase deg", "delay ms", "sensitivity"),
    )
    actuator = vgtjax.Actuator()
    cases = cross_cases({"printed": actuator}, {"Signal 1": control.signal_1()}, duration=0.1)
    for name, design in DESIGNS.items():
        found = sliding_margins({"printed": design.for_plant(actuator)}, cases, lanes=1)["printed"]
        for way, of in found.items():
            figures = (of.gain, of.phase, 1e3 * of.delay, of.sensitivity)
            cells = [f"{value:.3g}" for value in figures] if of.stable else ["not stable", "", "", ""]
            section.add(name, way, *cells)
    return section
