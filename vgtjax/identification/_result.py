"""What every bench test returns, and how a test says that it is not possible."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._errors import SimulationError
from .._printing import Cells, Printed
from ..parameters import Parameter, parameter_table, table_row
from ..plants import AbstractRodModel
from ..traces import Trace

POINTS = 1500
"""Of a curve: more than a picture shows."""


class NotPossible(Exception):
    """The traces, or the model, don't allow a test; the arguments are sentences that say why."""


@dataclasses.dataclass(frozen=True, eq=False)
class Coefficients:
    """Values and standard errors of the terms of a law by name, in SI units; NaN for what is not determined."""

    values: dict[str, float]
    std_errors: dict[str, float]

    def relative_error(self, name: str) -> float:
        """Standard error over value, infinite where the value is not determined."""
        error = self.std_errors.get(name, np.nan) / abs(self.values.get(name, np.nan))
        return float(error) if np.isfinite(error) else np.inf

    def value(self, name: str) -> float:
        """A value, or zero where it is not determined."""
        value = self.values.get(name, 0.0)
        return 0.0 if np.isnan(value) else value


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


def thinned(count: int) -> slice:
    """Every so-many-th of `count` samples, so that a curve has about `POINTS`."""
    return slice(None, None, max(1, count // POINTS))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Identified(Printed):
    """Parameters that one bench test determines, with standard errors, and what it could not determine.

    `values` and `std_errors` are by parameter name, in the units of the parameter table; scalars have shape `()`,
    vectors `(size,)`. What the test does not determine is left out of `values`, or has a standard error of NaN where it
    is an entry of a vector, and a sentence in `limitations` says why. `method` says in a sentence which samples were
    used and what was solved. `figures` are for a quick look; `table` has the rows of the model's parameters.
    """

    name: str = ""
    equations: str = ""
    method: str = ""
    values: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    std_errors: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    limitations: tuple[str, ...] = ()
    figures: tuple[Curve, ...] = ()
    samples: int = 0
    """Number of samples or equilibria used."""
    table: dict[str, Parameter] = dataclasses.field(default_factory=dict)

    def rows(self) -> list[tuple[str, float, float, str]]:
        """Entry, value, standard error and unit of everything found, as terminal and notebook show it."""
        found = []
        for name in self.values:
            values = np.ravel(self.values[name])
            entries = [f"{name}[{i}]" for i in range(len(values))] if np.ndim(self.values[name]) else [name]
            errors = np.ravel(self.std_errors.get(name, np.full(len(values), np.nan)))
            units = [str(table_row(self.table, entry).unit) if name in self.table else "" for entry in entries]
            found += list(zip(entries, values.tolist(), errors.tolist(), units, strict=True))
        return found

    def _title(self) -> str:
        title = f"{self.name} [{self.equations}]" + ("" if self.values else ": not possible")
        return "\n".join([title, *self.limitations])

    def _tables(self) -> list[Cells]:
        rows = [
            (entry, f"{value:.5g}", f"{error:.2g}" if np.isfinite(error) else "", unit)
            for entry, value, error, unit in self.rows()
        ]
        return [[("parameter", "value", "std. error", "unit"), *rows]] if rows else []


Test = Callable[[Any, Sequence[Trace]], Identified]
"""A bench test. `Any` model, because each test says which it reads: any rod, a whole actuator, a plant."""


def bench_test(name: str, equations: str, method: str) -> Callable[[Test], Test]:
    """Names a test, and turns what makes it impossible, a simulation that fails included, into its `limitations`."""

    def decorate(test: Test) -> Test:
        @functools.wraps(test)
        def run(model: AbstractRodModel, traces: Sequence[Trace]) -> Identified:
            try:
                found = test(model, traces)
            except (NotPossible, SimulationError) as reason:
                sentences = reason.args if isinstance(reason, NotPossible) else (str(reason),)
                found = Identified(limitations=sentences)
            return dataclasses.replace(
                found, name=name, equations=equations, method=found.method or method, table=parameter_table(model)
            )

        return run

    return decorate
