"""What varies from actuator to actuator: single values, and the level of a whole curve."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._types import Module
from ..parameters import (
    Selection,
    entry_names,
    get_parameter,
    match_entries,
    parameter_table,
    replace_parameters,
    table_row,
)
from ..plants import AbstractModel, AbstractRodModel


class Factors(eqx.Module):
    """The quantities of a population, in the order of the parameter table.

    A scalar parameter, or one entry `name[2]` of a vector, is varied by its value. A vector's bare name stands for a
    factor, one for the nominal actuator, that multiplies all of its entries.
    """

    entries: tuple[str, ...] = eqx.field(static=True)

    def pack(self, model: AbstractModel) -> Float[Array, " factors"]:
        """The nominal actuator's values."""
        table = parameter_table(model)
        one = jnp.ones(())
        values = [one if is_curve(table, entry) else Selection((entry,)).pack(model)[0] for entry in self.entries]
        return jnp.stack(values) if values else jnp.zeros(0)

    def unpack(self, model: Module, vector: Float[Array | np.ndarray, " factors"]) -> Module:
        """`model` with these values."""
        table = parameter_table(model)
        for position, entry in enumerate(self.entries):
            if is_curve(table, entry):
                model = replace_parameters(model, {entry: vector[position] * get_parameter(model, entry)})
        single = {entry: vector[i] for i, entry in enumerate(self.entries) if not is_curve(table, entry)}
        return Selection(tuple(single)).unpack(model, jnp.stack(list(single.values()))) if single else model

    def restores(self, model: AbstractModel) -> bool:
        """Whether `unpack` gives its own values back to a model."""
        return True

    def units(self, model: AbstractModel) -> list[str]:
        """Unit of each quantity."""
        table = parameter_table(model)
        return ["1" if is_curve(table, e) else str(table_row(table, e).unit) for e in self.entries]


VISCOUS = "friction.viscous_damping"
"""What is raised until friction is passive."""


class PassiveFactors(Factors):
    """The quantities of a population without its viscous damping, which a member has as much more of as its other
    values ask for: no member has friction that can give out energy."""

    def unpack(self, model: Module, vector: Float[Array | np.ndarray, " factors"]) -> Module:
        """`model` with these values, and the least viscous damping at least with which its friction is passive."""
        return raised_to_passive(super().unpack(model, vector))

    def restores(self, model: AbstractModel) -> bool:
        """Whether a model needs no more viscous damping."""
        return not isinstance(model, AbstractRodModel) or model.friction.is_passive


def raised_to_passive(model: Module) -> Module:
    """`model` with the least viscous damping at least with which its friction is passive, if there is such a one."""
    margin = model.friction.passivity_margin() if isinstance(model, AbstractRodModel) else None
    if margin is None:
        return model
    # A little more than the least: rounding may not put it back outside.
    more = (1 + 1e-9) * jnp.maximum(-margin, 0.0)
    return replace_parameters(model, {VISCOUS: get_parameter(model, VISCOUS) + more})


def differing_factors(models: Sequence[AbstractModel]) -> Factors:
    """The entries whose values are not the same in all models, which are alike but for these."""
    table = parameter_table(models[0])
    entries = tuple(entry_names(table))
    values = np.stack([Selection(entries).values(model) for model in models])
    differ = np.any(values != values[0], axis=0)
    return Factors(tuple(entry for entry, apart in zip(entries, differ, strict=True) if apart))


def is_curve(table: dict, entry: str) -> bool:
    """Whether a name of a population is that of a whole vector."""
    return entry in table and table[entry].size is not None


def choose_factors(model: AbstractModel, patterns: Sequence[str], fixed: Sequence[str] = ()) -> Factors:
    """The quantities that names or patterns address: whole vectors, unless `name[2]` picks an entry.

    What `fixed` addresses stays, whole vectors with all of their entries.

    **Raises:** `InputError` for a pattern that matches nothing, or an entry beside its whole vector.
    """
    table = parameter_table(model)

    def address(pattern: str) -> list[str]:
        if pattern.endswith("]"):
            return [entry for entry in entry_names(table) if entry in match_entries(table, [pattern])]
        bases = {_base(entry) for entry in match_entries(table, [pattern])}
        return [name for name in table if name in bases]

    left_out = {entry for pattern in fixed for entry in address(pattern)}
    chosen = {entry for pattern in patterns for entry in address(pattern)}
    chosen = {entry for entry in chosen if entry not in left_out and _base(entry) not in left_out}
    for entry in sorted(chosen | left_out):
        if _base(entry) != entry and _base(entry) in chosen:
            what = "both vary" if entry in chosen else "be fixed and vary"
            raise InputError(f"'{entry}' and the whole '{_base(entry)}' can't {what}; name one of them")
    order = [name for base in table for name in (base, *entry_names({base: table[base]}))]
    return Factors(tuple(dict.fromkeys(name for name in order if name in chosen)))


def _base(entry: str) -> str:
    return entry.partition("[")[0]
