"""Where a study states what the library calls an argument."""

import contextlib
from collections.abc import Iterator, Mapping

from vgtjax import InputError

OF_A_MODEL = {
    "values": "[parameters]",
    "bounds": "[parameters]",
    "free": "[fit]",
    "fixed": "[fit]",
    "posterior": "[fit]",
    "traces": "[[trace]]",
    "unknown": "[fit.unknown]",
}
"""Tables of a study by the arguments of fits and simulations."""
OF_A_CONTROLLER = {
    "values": "[control.gains]",
    "bounds": "[control.gains]",
    "gains": "[control.gains]",
    "free": "[control]",
    "fixed": "[control]",
}
"""The same for tuning."""
OF_A_POPULATION = {
    "vary": "[population]",
    "fixed": "[population]",
    "spreads": "[population.parameters]",
    "correlations": "[[population.correlation]]",
}
"""The same for populations."""


@contextlib.contextmanager
def stated(places: Mapping[str, str]) -> Iterator[None]:
    """Errors within, on an argument of the library, also say in which table of the study that argument is stated.

    **Raises:** `InputError` that names the place, so that those who hear of it further out add no other.
    """
    try:
        yield
    except InputError as error:
        place = places.get(error.argument or "")
        if place is None:
            raise
        raise InputError(f"{error} (see {place} in the study)") from error
