"""The modules inside a module."""

import dataclasses
from collections.abc import Iterator

import equinox as eqx


def parts(module: eqx.Module, prefix: str = "", leave_out: tuple[type, ...] = ()) -> Iterator[tuple[str, eqx.Module]]:
    """A module and all modules inside it, each with the start of its parameters' names: empty, or e.g. `observer.`.

    Those of the types `leave_out` are left out, with all that is inside them.
    """
    yield prefix, module
    for field in dataclasses.fields(module):
        value = getattr(module, field.name)
        if isinstance(value, eqx.Module) and not isinstance(value, leave_out):
            yield from parts(value, f"{prefix}{field.name}.", leave_out)
