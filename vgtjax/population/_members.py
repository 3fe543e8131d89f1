"""Drawn actuators that can exist, and why the others can't."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .._errors import InputError, SimulationError
from ..parts import has_tables
from ..plants import AbstractModel, is_physical
from ._factors import Factors

SWALLOWED = "the diaphragm swallows the chamber"
NO_WORK, NO_FLOW = "the nozzle does not work", "no steady flow is found through the nozzle"
"""Why a drawn actuator has no table of its vane force."""


@dataclasses.dataclass(frozen=True, eq=False)
class Members:
    """Actuators of a population, by the `names` of all that were drawn: the `models` of those that can exist, and of
    the others why they were `refused`, a clause such as "the diaphragm swallows the chamber"."""

    names: tuple[str, ...]
    models: dict[str, AbstractModel]
    refused: dict[str, str]


def build_members(nominal: AbstractModel, factors: Factors, rows: Float[np.ndarray, "members factors"]) -> Members:
    """Members with the values of some rows, called `sample 0` and so on.

    **Raises:** `InputError` for values that the nominal actuator refuses though it has no table to fill.
    """
    names = tuple(f"sample {number}" for number in range(len(rows)))
    models, refused = dict[str, AbstractModel](), dict[str, str]()
    for name, row in zip(names, rows, strict=True):
        try:
            model = factors.unpack(nominal, row)
        except (InputError, SimulationError) as error:
            if not has_tables(nominal):
                raise
            refused[name] = NO_WORK if isinstance(error, InputError) else NO_FLOW
            continue
        if is_physical(model):
            models[name] = model
        else:
            refused[name] = SWALLOWED
    return Members(names, models, refused)
