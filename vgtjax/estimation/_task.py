"""What to calibrate: which parameters, by which traces."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..parameters import Bounds, Selection, bounds_by_entry, replace_parameters, select
from ..plants import AbstractModel, MechanicalActuator
from ..simulation import FixedStep
from ..traces import Trace
from ._bundle import CHANNELS
from ._evidence import NOTHING, Unknown
from ._holds import ramped


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """What to calibrate: a model with its start values, the free entries, and the traces.

    `bounds` are by entry, in the units of the table; `channels` the measured signals to fit; `unknown` is what the fit
    finds out besides; `linear` has the sample intervals in s of traces whose duty is linear between samples, though
    they don't say so.
    """

    model: AbstractModel
    selection: Selection
    fit: Sequence[Trace]
    validate: Sequence[Trace] = ()
    bounds: Bounds = dataclasses.field(default_factory=dict)
    channels: Sequence[str] = CHANNELS
    stepping: FixedStep = dataclasses.field(default_factory=FixedStep)
    unknown: Unknown = NOTHING
    linear: Sequence[float] = ()

    @property
    def traces(self) -> list[Trace]:
        """Traces to fit, with the duty as it is read."""
        return ramped(self.fit, self.linear)

    @property
    def late_duty(self) -> bool:
        """Whether the duty may be late."""
        return bool(self.unknown.duty_delay) and "pwm" in self.model.needs

    @property
    def first_guess(self) -> Float[np.ndarray, " coordinates"]:
        """Start values in the units of the table, and a duty that is not late where it may be."""
        return np.append(np.asarray(self.selection.pack(self.model)), np.zeros(int(self.late_duty)))


def plan_task(
    model: AbstractModel,
    fit: Sequence[Trace],
    validate: Sequence[Trace] = (),
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    values: dict[str, Any] | None = None,
    bounds: Bounds | None = None,
    channels: Sequence[str] | None = None,
    unknown: Unknown = NOTHING,
) -> Task:
    """Puts a task together from names.

    **Arguments:**

    - `free`, `fixed`: names or fnmatch patterns; all that is not held by default, and `fixed` beats `free`.
    - `values`: start values by name, in the units of the table.
    - `bounds`: `(lower, upper)` by name or entry, either `None`.
    - `channels`: measured signals to fit; by default those that are no input of the model.
    - `unknown`: what the fit finds out besides the parameters; nothing by default.

    **Raises:** `InputError` for unknown names, and when no trace is to be fitted.
    """
    if not fit:
        raise InputError("a fit needs at least one trace, but there is none; give one", "traces")
    model = replace_parameters(model, values or {})
    if channels is None:
        channels = ("x_d",) if isinstance(model, MechanicalActuator) else CHANNELS
    return Task(
        model,
        select(model, free, fixed),
        fit,
        validate,
        bounds_by_entry(model, bounds or {}),
        channels,
        unknown=unknown,
    )
