"""A fit of all free parameters at once, begun where identification says that it had better begin."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from .._errors import InputError
from ..estimation import Calibration, Calibrator, Computation, Progress, Task, Unknown, plan_task, run_alone, starting
from ..parameters import Bounds
from ..plants import AbstractModel, AbstractRodModel, require_physical
from ..traces import Trace
from ._filters import gas_pressure, has_gas
from ._second_guess import second_guess
from .mechanical import better_start, moves_at_start


def fit(
    model: AbstractModel,
    traces: Sequence[Trace],
    validate: Sequence[Trace] = (),
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    values: dict[str, Any] | None = None,
    bounds: Bounds | None = None,
    channels: Sequence[str] | None = None,
    unknown: Unknown | None = None,
    deviations: Mapping[str, float] | None = None,
    centers: Mapping[str, float] | None = None,
    scales: Mapping[str, str] | None = None,
    starts: int = 1,
    gains: Mapping[str, float] | None = None,
    offsets: Mapping[str, float] | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Calibration:
    """Calibrates a model to traces by exact gradients.

    Whether the values can be signed [`certified_fit`][] says, as the command `fit` does: it checks the last derivatives
    against differences, searches on with finer steps where they fail, and looks around the end.

    **Arguments:**

    - `traces`, `validate`: measured traces to fit, and others that the result is only compared with.
    - `free`, `fixed`: names or fnmatch patterns; by default all that the table does not hold. `fixed` beats `free`.
    - `values`: start values by name, in the units of the table; by default those of `model`.
    - `bounds`: `(lower, upper)` by name, pattern or entry, either `None`.
    - `channels`: measured signals to fit; by default those that are no input of the model.
    - `unknown`: what the fit finds out besides the parameters; by default what [`Unknown`][] decides by evidence.
    - `deviations`: standard deviations by name or entry, in the units of the table: of what is free a Gaussian prior
      (of its logarithm where it moves by that), of what is held a tolerance that goes into every error.
    - `centers`: what priors are about, by name or entry; by default the start values.
    - `scales`: by name or entry, `"log"` of what moves by its logarithm, `"linear"` of what moves in units of its size;
      positive ones move by their logarithm by default, others linearly. A positive one that moves linearly keeps
      a thousandth of its start value at least.
    - `starts`: from how many places the search begins: the start values, and others around them by up to a factor of
      1.5, or by two standard deviations of what is known beforehand; the best end counts.
    - `gains`: relative standard uncertainty (k = 1) of the gain of each sensor, by channel: of one that `unknown` frees
      what is known beforehand, of another a part of every error.
    - `offsets`: the same of the offset of an input, in its unit (m, Pa or N).
    - `report`: called with the progress after every step.

    **Returns:** values, standard errors, and how the traces are met; it prints itself as a table. Ask `converged`.

    **Raises:** `InputError` as [`plan_fit`][]; `SimulationError` when the start can't be simulated.
    """
    task = plan_fit(
        model,
        traces,
        validate,
        free=free,
        fixed=fixed,
        values=values,
        bounds=bounds,
        channels=channels,
        unknown=unknown,
        deviations=deviations,
        centers=centers,
        scales=scales,
        starts=starts,
        gains=gains,
        offsets=offsets,
    )
    return start_fit(task).run(report)


def plan_fit(model: AbstractModel, traces: Sequence[Trace], validate: Sequence[Trace] = (), **choices: Any) -> Task:
    """A task whose start may be fitted; arguments as those of [`fit`][].

    **Raises:** `InputError` for unknown names, no trace, nothing free, a start value outside its domain or bounds, or
    an actuator that can't exist.
    """
    require_physical(model)
    unknown = choices.pop("unknown", None)
    task = plan_task(model, traces, validate, unknown=Unknown() if unknown is None else unknown, **choices)
    task = dataclasses.replace(task, second_guess=second_guess)
    if not task.selection.entries:
        raise InputError("a fit needs at least one free parameter, but free and fixed leave none; free one", "free")
    task.transform()  # mistakes of start values and bounds show here
    return task


def start_fit(task: Task, resume: Progress | None = None) -> Calibrator:
    """Compiles a task and finds where its search begins; its notes say where that is not the start values.

    **Arguments:** `resume`: the last progress of the same task, interrupted.

    **Raises:** as [`start_calibration`][].
    """
    return run_alone(starting_fit(task, resume))


def starting_fit(task: Task, resume: Progress | None = None) -> Computation[Calibrator]:
    """`start_fit` as a computation, for [`run_together`][]."""
    if resume is not None:
        return (yield from starting(task, resume))
    notes = [*_moving_starts(task), *_unheard_gas(task)]
    begin = better_start(task)
    if begin is not None:
        notes.append("the search begins at what a regression of force and position tells")
    return (yield from starting(task, begin, tuple(notes)))


def _moving_starts(task: Task) -> list[str]:
    """Which traces begin in motion."""
    notes = []
    for trace in task.fit:
        moving = moves_at_start(trace)
        if moving is not None:
            notes.append(
                f"{trace.name}: it begins at {moving[0]:.2g} m/s, but a simulation begins at rest; "
                f"a window from {moving[1]:.3f} to {trace.time[-1]:.3f} s leaves that out"
            )
    return notes


def _unheard_gas(task: Task) -> list[str]:
    """That a trace has exhaust gas and the model no force of it, if so."""
    if not isinstance(task.plant, AbstractRodModel) or task.plant.vane_force.feels_gas:
        return []
    most = max(task.fit, key=gas_pressure)
    if not has_gas(most):
        return []
    return [
        f"the turbine pressure of {most.name} reaches {gas_pressure(most):.4g} Pa gauge, but the model has no vane "
        "force; choose one, or what exhaust gas does is read as friction and springs"
    ]
