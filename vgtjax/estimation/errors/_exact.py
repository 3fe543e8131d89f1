"""What the errors of a fit take for exact because nobody has said how well it is known."""

import numpy as np

from ...parameters import get_parameter, parameter_table
from ...parts import Turbine
from ...plants import AbstractRodModel
from .._task import Task
from ..measurements import inputs_of

NAMED = 6
"""Values that a sentence names; of more it has the number."""


def taken_for_exact(task: Task, deviations: str = "deviations", gains: str = "gains") -> list[str]:
    """A sentence on each thing that errors of a task take for exact.

    **Arguments:** where a user says how well a value and a sensor's gain are known: by default in the arguments of
    [`plan_task`][].
    """
    return [*filter(None, (_held(task, deviations, gains), _assumed(task, deviations)))]


def _held(task: Task, deviations: str, gains: str) -> str | None:
    known = {entry.partition("[")[0] for entry in (*task.selection.entries, *task.deviations)}
    plant, table = task.plant, parameter_table(task.plant)
    held = [name for name in table if name not in known and not name.startswith("air.")]
    held = [name for name in held if np.any(get_parameter(plant, name))]
    held.sort(key=lambda name: not table[name].held)  # those first that no trace tells
    sensors = [*task.channels, *_driving(task)]
    exact = [channel for channel in sensors if channel not in (*task.gains, *task.unknown.gain)]
    if not held and not exact:
        return None
    more = f" and {len(held) - NAMED} more" if len(held) > NAMED else ""
    what = [f"the values held of {', '.join(held[:NAMED])}{more}"] if held else []
    what += [f"the gains of the sensors of {' and '.join(exact)}"] if exact else []
    how = [deviations] if held else []
    how += [gains] if exact else []
    return (
        f"all errors take {' and '.join(what)} for exact: a value that is not measured is a start value; say how well "
        f"these are known ({', '.join(how)})"
    )


def _driving(task: Task) -> list[str]:
    """The sensor of what drives a rod alone, by which every force is known."""
    return [] if "pwm" in task.plant.needs else [inputs_of(task.plant, task.fit)[0]]


def _assumed(task: Task, deviations: str) -> str | None:
    """Of what is taken for granted where something of a turbine is free."""
    if not isinstance(task.plant, AbstractRodModel) or not isinstance(task.plant.vane_force, Turbine):
        return None
    mine = {name: row for name, row in parameter_table(task.plant).items() if name.startswith("vane_force.")}
    free = [name for name in mine if name in task.selection.entries]
    exact = [name for name, row in mine.items() if row.assumed and name not in (*free, *task.deviations)]
    if not free or not exact:
        return None
    return (
        f"errors of {', '.join(free)} take {len(exact)} assumed values of the turbine for exact, which no measured "
        f"vane force validates: state how well they are known ({deviations}), or free them"
    )
