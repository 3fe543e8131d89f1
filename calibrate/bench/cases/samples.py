"""What a sample of each design costs where it is written as C."""

import vgtjax

from ...fmu.cost import sample_cost
from ...tune.designs import DESIGNS
from ..table import Section, seconds

PERIOD = 1e-3
"""s"""


def measure() -> Section:
    """Writes and compiles each design for the printed actuator."""
    section = Section(
        "A sample of a controller in C",
        "Each design with default gains for the printed actuator, as `export` writes it, compiled with `-O2` for this "
        "machine.",
        ("design", "operations", "a sample", "numbers remembered", "gains and beliefs"),
    )
    for name, design in DESIGNS.items():
        cost = sample_cost(design.for_plant(vgtjax.Actuator()), PERIOD)
        took = "no compiler" if cost.seconds is None else seconds(cost.seconds)
        section.add(f"`{name}`", f"{cost.operations:,}", took, str(cost.memory), str(cost.parameters))
    return section
