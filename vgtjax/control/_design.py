"""What a design owes beside its law: the conditions of its proof, as one table for errors and for tuning."""

import dataclasses
import math
from collections.abc import Iterator

import jax
import numpy as np
from jaxtyping import Array, Bool

from .._errors import InputError, is_traced
from .._types import Values
from ..parameters import Part


@dataclasses.dataclass(frozen=True, eq=False)
class Condition:
    """One inequality that a design keeps, or its proof says nothing.

    An error says "`rule`, but it is `value`; `remedy`", with `limit` in the place that the rule has for it.
    """

    margin: Values
    """Positive where it is kept, with derivatives with respect to the gains; as a part of the limit."""
    rule: str
    """E.g. `gain must be below {limit:.4g} 1/s`."""
    value: Values
    remedy: str
    limit: Values = math.nan
    closed: bool = False
    """Whether a margin of zero will do."""
    bounds_gains: bool = True
    """Whether a search for gains has to heed it; a sign need not be, as a search keeps to the domains of gains."""

    asked: bool | Bool[Array, ""] = True
    """Whether there is anything to keep; where nothing is, the margin is one."""

    def require(self) -> None:
        """**Raises:** `InputError` where it is broken, with the worst value."""
        margin = np.asarray(self.margin)
        if np.all(margin >= 0 if self.closed else margin > 0):
            return
        worst = np.unravel_index(np.argmin(margin), margin.shape)
        value, limit = (np.broadcast_to(np.asarray(number), margin.shape)[worst] for number in (self.value, self.limit))
        raise InputError(f"{self.rule.format(limit=limit)}, but it is {value}; {self.remedy}")


class AbstractDesign(Part):
    """A controller, or a part that has gains: a differentiator, an observer.

    Its own parameters are gains but for those that are held, and those of the designs inside it are as well. Any other
    component in its fields, a diaphragm for instance, is what it believes of the plant. A parameter with a
    `tuning_width` is the width of a law that switches, and is made no less than that while gains are tuned.
    """

    def conditions(self) -> dict[str, Condition]:
        """What must hold beside the domains of parameters, by name; of this design alone, not of those inside it.

        Nothing, unless a design says otherwise.
        """
        return {}

    def __check_init__(self) -> None:
        # While it is traced nothing is known.
        if is_traced(self):
            return
        with jax.ensure_compile_time_eval():
            for condition in self.conditions().values():
                condition.require()


def designs_in(design: AbstractDesign, prefix: str = "") -> Iterator[tuple[str, AbstractDesign]]:
    """A design and all designs inside it, each with what its parameters' names begin with: nothing, or `observer.`"""
    yield prefix, design
    for field in dataclasses.fields(design):
        value = getattr(design, field.name)
        if isinstance(value, AbstractDesign):
            yield from designs_in(value, f"{prefix}{field.name}.")


def check(design: AbstractDesign) -> None:
    """Checks a design whose parameters were replaced, as building it does.

    **Raises:** `InputError` for a condition that is broken, of the design or one inside it.
    """
    for _, part in designs_in(design):
        for condition in part.conditions().values():
            condition.require()


def positive(design: AbstractDesign, *names: str) -> dict[str, Condition]:
    """Conditions that some parameters are not zero either, which their domains admit."""
    values = {name: getattr(design, name) for name in names}
    return {
        f"{name} positive": Condition(value, f"{name} must be positive", value, "raise it", bounds_gains=False)
        for name, value in values.items()
    }
