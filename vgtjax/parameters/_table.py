"""The parameter table: name, symbol, unit, default, domain and source, declared beside each equation.

A physical parameter is an array field of an equinox module, declared with [`parameter`][]. Its name is the path of the
field, for instance ``diaphragm.stiffness``; everything that needs names, units, bounds or the set that is held by
default reads the same declaration through [`parameter_table`][].

Modules nest deeper than names do: a field declared with [`nested`][] is not part of the names of what is inside it, and
a module with one `anonymous` parameter gives it its own name.
"""

import abc
import dataclasses
import difflib
import inspect
import math
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._errors import InputError, is_traced
from .._types import Module


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One row of the parameter table.

    `positive` says that the domain is `(0, inf)`, so that a fit moves the logarithm; a value that is held may also be
    zero, which switches off what it multiplies. `lower` is the end of the domain of one that is not positive, and may
    be reached; `above` is the end of any other one, and may not: zero, of what divides. `infinite` says that infinity
    is a value too. `default` is the printed value. `held` parameters are measured, or can't be distinguished from
    others; a fit leaves them alone unless they are freed by name. `assumed` marks values that no source states. An
    `optional` one may be `None`, and is no parameter of that model then. `anonymous` parameters have the name of the
    module that they belong to. `axes` of a map are the parameters with the knots of its rows and of its columns, by the
    names of their fields in a declaration and by their own in a table.
    """

    symbol: str
    unit: str | tuple[str, ...]
    source: str
    positive: bool = True
    held: bool = False
    assumed: bool = False
    infinite: bool = False
    anonymous: bool = False
    optional: bool = False
    lower: float = -math.inf
    above: float | None = None
    default: float | tuple[float, ...] = 0.0
    name: str = ""
    size: int | None = None
    usual: float = 0.0
    """Size of a large but sane change of one whose printed value is zero."""
    axes: tuple[str, ...] = ()
    tuning_width: float = 0.0
    """Least width of a law that switches while gains are tuned; zero for what is no width."""

    @property
    def lowest(self) -> float:
        """The lower end of the domain."""
        if self.above is not None:
            return self.above
        return 0.0 if self.positive else self.lower

    def check(self, value: Any, name: str | None = None) -> None:
        """Whether a value lies in the domain; says nothing of one that is being traced.

        **Raises:** `InputError` otherwise, with `name` in place of the row's own.
        """
        if is_traced(value):
            return
        numbers, lowest = np.asarray(value, float), self.lowest
        good = (numbers >= lowest if self.above is None else numbers > lowest) & (
            np.isfinite(numbers) | (self.infinite & (numbers == math.inf))
        )
        if not np.all(good):
            rule = "finite" if lowest < 0 else f"finite and not {'negative' if lowest == 0 else f'below {lowest:g}'}"
            rule = rule if self.above is None else f"finite and above {lowest:g}"
            wrong = numbers[~good].flat[0]
            raise InputError(f"'{name or self.name}' must be {rule}, but it is {wrong:g}; correct it", "values")


class Part(eqx.Module):
    """A module whose parameters keep to their domains.

    **Raises:** `InputError` for a value outside the domain of its parameter, when it is built.
    """

    place: ClassVar[str] = ""
    """What its parameters' names begin with in a usual model, for messages."""

    def __init_subclass__(cls, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        rows = [_describe(name, field) for name, field in _declared(cls).items() if _is_parameter(field)]
        if rows:
            cls.__doc__ = "\n\n".join(
                [inspect.cleandoc(cls.__doc__ or cls.__name__), "**Parameters:**", "\n".join(rows)]
            )

    def __check_init__(self) -> None:
        owner = self.place or type(self).__name__
        for field in dataclasses.fields(self):
            row = field.metadata.get("parameter")
            if row is not None and not (row.optional and getattr(self, field.name) is None):
                row.check(getattr(self, field.name), owner if row.anonymous else f"{owner}.{field.name}")


def _declared(cls: type) -> dict[str, Any]:
    """What a class and those that it is derived from declare, in the order of its fields."""
    declared: dict[str, Any] = {}
    for each in reversed(cls.__mro__):
        # The fields of a class that is being made are still in its namespace only.
        declared |= {**vars(each), **vars(each).get("__dataclass_fields__", {})}
    return declared


def _is_parameter(field: Any) -> bool:
    return isinstance(field, dataclasses.Field) and "parameter" in field.metadata


def _describe(name: str, field: dataclasses.Field) -> str:
    """A parameter in one line of its class's documentation."""
    row: Parameter = field.metadata["parameter"]
    unit = row.unit if isinstance(row.unit, str) else ", ".join(row.unit)
    said = "assumed" in row.source
    marks = [row.source, *(["assumed"] * (row.assumed and not said)), *(["held"] * row.held)]
    return f"- `{name}`: {row.symbol} in {unit}, {row.default} [{', '.join(marks)}]"


class AbstractDerived(Part):
    """A part that carries something which takes long to compute from its parameters."""

    @abc.abstractmethod
    def renewed(self) -> "AbstractDerived":
        """The same part with what it carries computed from its parameters as they are, or without it while these are
        traced."""


def _renew_moved(old: Module, new: Module) -> Module:
    """`new` with each part renewed of which a value is not that of `old`."""

    def derived(node: Any) -> bool:
        return isinstance(node, AbstractDerived)

    def renew(before: Any, after: Any) -> Any:
        pairs = zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True)
        return after.renewed() if derived(after) and any(a is not b for a, b in pairs) else after

    return jax.tree.map(renew, old, new, is_leaf=derived)


def as_float_array(value: Any, what: str = "a quantity") -> Array:
    """A value as a floating array, in its own precision if it has one; `what` it is, for messages.

    **Raises:** `InputError` for what is no number.
    """
    if hasattr(value, "dtype") and jnp.issubdtype(value.dtype, jnp.inexact):
        return jnp.asarray(value)
    try:
        return jnp.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} must be a number, or an array of numbers, but it is {value!r}; give one") from error


def optional_float_array(value: Any) -> Array | None:
    """The same of a value that may be left out, which is `None`."""
    return None if value is None else as_float_array(value)


def parameter(
    default: float | tuple[float, ...], *, symbol: str, unit: str | tuple[str, ...], source: str, **row: Any
) -> Any:
    """Declares a physical parameter as a field of an equinox module.

    **Arguments:**

    - `default`: value in `unit`; tuples of both for a vector.
    - `symbol`, `unit`, `source`: as printed in the thesis.
    - `row`: `positive`, `lower`, `above`, `infinite`, `held`, `assumed`, `anonymous`, `optional`, `axes`, `usual`
      and `tuning_width` of [`Parameter`][]. What has a `lower` end is not positive, and what `source` says is
      assumed is so; neither has to be said again.
    """
    implied: dict[str, Any] = {"positive": "lower" not in row, "assumed": "assumed" in source}
    what = f"the parameter {symbol}" + (f" in {unit}" if isinstance(unit, str) else "")
    described = Parameter(symbol, unit, source, default=default, **implied | row)

    def convert(value: Any) -> Any:
        return None if value is None and described.optional else as_float_array(value, what)

    return eqx.field(
        default=None if described.optional else default, converter=convert, metadata={"parameter": described}
    )


def nested(**settings: Any) -> Any:
    """Declares a field whose parts keep the names that they would have without it; arguments of `equinox.field`."""
    return eqx.field(metadata={"nested": True}, **settings)


def _walk(module: eqx.Module, prefix: str) -> Iterator[tuple[str, Parameter, Array]]:
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if isinstance(value, eqx.Module):
            yield from _walk(value, prefix if "nested" in field.metadata else f"{prefix}{field.name}.")
        elif "parameter" in field.metadata and value is not None:
            row = field.metadata["parameter"]
            yield prefix.removesuffix(".") if row.anonymous else prefix + field.name, row, value


def parameter_table(model: eqx.Module) -> dict[str, Parameter]:
    """Every parameter of `model` by name, in the order of its fields."""
    return {name: _in_table(name, row, value) for name, row, value in _walk(model, "")}


def _in_table(name: str, row: Parameter, value: Array) -> Parameter:
    owner = name[: name.rfind(".") + 1]
    size = None if np.ndim(value) == 0 else np.shape(value)[-1]
    return dataclasses.replace(row, name=name, size=size, axes=tuple(owner + axis for axis in row.axes))


def get_parameter(model: eqx.Module, name: str) -> Array:
    """The value of the parameter called `name`, in the unit of the table.

    **Raises:** `InputError` when there is none of that name.
    """
    for found, _, value in _walk(model, ""):
        if found == name:
            return value
    raise unknown_name("parameter", name, parameter_table(model))


def replace_parameters(model: Module, values: dict[str, Any]) -> Module:
    """A copy of `model` with the named parameters replaced; values in the units of the table, precision as it was.

    **Raises:** `InputError` for a name that is none, or a value outside its domain.
    """
    if not values:
        return model
    table = parameter_table(model)
    for name, value in values.items():
        if name not in table:
            raise unknown_name("parameter", name, table, "values")
        table[name].check(value)
    new = [as_float_array(values[name]).astype(old.dtype) for name, _, old in _walk(model, "") if name in values]
    replaced = eqx.tree_at(lambda m: [old for name, _, old in _walk(m, "") if name in values], model, new)
    return _renew_moved(model, replaced)


def unknown_name(kind: str, given: str, known: Iterable[str], argument: str | None = None) -> InputError:
    """The sentence for a name or pattern that matches nothing, with the nearest known one."""
    near = difflib.get_close_matches(given, list(known), n=1, cutoff=0.0)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return InputError(f"{kind} '{given}' matches nothing{hint}", argument)
