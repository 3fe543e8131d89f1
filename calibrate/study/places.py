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
    "models": "[population]",
    "vary": "[population]",
    "fixed": "[population]",
    "spreads": "[population.parameters]",
    "correlations": "[[population.correlation]]",
}
"""The same for populations."""


class StudyError(InputError):
    """What a study says breaks a rule; who runs the command knows the name of its file."""


@contextlib.contextmanager
def of_study() -> Iterator[None]:
    """Errors within are on what a study says.

    **Raises:** `StudyError` for every `InputError`.
    """
    try:
        yield
    except StudyError:
        raise
    except InputError as error:
        raise StudyError(str(error), error.argument) from error


@contextlib.contextmanager
def stated(places: Mapping[str, str]) -> Iterator[None]:
    """Errors within, on an argument of the library, also say in which table of the study that argument is stated.

    **Raises:** `StudyError` that names the place, so that those who hear of it further out add no other.
    """
    try:
        yield
    except InputError as error:
        place = places.get(error.argument or "")
        if place is None:
            raise
        raise StudyError(f"{error} (see {place} in the study)") from error
