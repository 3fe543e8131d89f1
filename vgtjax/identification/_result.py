"""What every identification returns."""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class Curve:
    """One picture of an identification: what was measured, and the identified law through it.

    `points` and `line` are pairs of arrays `(x, y)` in the units of the labels. Curves of one title and the same labels
    share a picture, and `name` tells them apart.
    """

    x_label: str
    y_label: str
    points: tuple[np.ndarray, np.ndarray]
    line: tuple[np.ndarray, np.ndarray]
    title: str = ""
    name: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Identified:
    """Parameters that one bench test tells, with standard errors, and what it could not see.

    `values` and `std_errors` are by parameter name, in the units of the parameter table; scalars have shape `()`,
    vectors `(size,)`. An entry that the test does not determine is left out of `values`, or has a standard error of
    NaN where it is one of a vector, and a sentence in `unseen` says why. `figures` are for a quick look.
    """

    name: str
    equations: str
    method: str
    """One sentence: which samples were used and what was solved."""
    values: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    std_errors: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    unseen: tuple[str, ...] = ()
    figures: tuple[Curve, ...] = ()
    samples: int = 0
    """Number of samples or equilibria used."""
