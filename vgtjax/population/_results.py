"""What experiments read off many actuators, by the names of their outputs."""

import dataclasses
import math
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from .._printing import Cells, Printed
from ..experiments import Output
from ..parameters import unknown_name
from ..simulation import RESULTS, HasEnds
from ._yield import Limits, Yield, keeps, yield_of

CAUSES: tuple[str, ...] = tuple(RESULTS._name_to_item)
"""Names of the members of `RESULTS` in the order of their numbers, which equinox keeps to itself."""
SHARES = (0.05, 0.95)
"""Quantiles that results print of themselves."""


@dataclasses.dataclass(frozen=True, eq=False)
class OutputTable:
    """Numbers and curves of some rows, read by name: `table["hysteresis_0mbar"]`.

    `matrix` holds all of them side by side, in SI units, a column for each number and each point of a curve;
    `columns` are the names of these. NaN where a response does not have an output.
    """

    outputs: tuple[Output, ...]
    matrix: Float[np.ndarray, "rows columns *more"]

    def __getitem__(self, name: str) -> Float[np.ndarray, "rows ..."]:
        """One output of all rows: `(rows,)` of a number, `(rows, points)` of a curve.

        **Raises:** `InputError` for a name that is none of the outputs.
        """
        first = 0
        for output in self.outputs:
            if output.name == name:
                return self.matrix[:, first : first + output.size] if output.axis else self.matrix[:, first]
            first += output.size
        raise unknown_name("output", name, self)

    def __iter__(self) -> Iterator[str]:
        """Names of the outputs."""
        return (output.name for output in self.outputs)

    def __contains__(self, name: object) -> bool:
        return any(output.name == name for output in self.outputs)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of `matrix`: outputs, with a number for every point of a curve."""
        return column_names(self.outputs)

    def select(self, outputs: Sequence[Output]) -> "OutputTable":
        """The same rows with some of the outputs."""
        parts = [self[output.name].reshape(len(self.matrix), output.size, -1) for output in outputs]
        matrix = np.concatenate(parts, axis=1).reshape(len(self.matrix), -1, *self.matrix.shape[2:])
        return dataclasses.replace(self, outputs=tuple(outputs), matrix=matrix)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Results(Printed, HasEnds, OutputTable):
    """What the experiments read off some actuators; all outputs of a simulation that failed are NaN.

    `result` says of every row how its simulations ended, by the first that failed: `results.result ==
    RESULTS.diverged` has the shape `(rows,)`.
    """

    result: RESULTS

    @property
    def status(self) -> RESULTS:
        """Deprecated: the former name of `result`."""
        warnings.warn("status of Results is called result; use that", DeprecationWarning, stacklevel=2)
        return self.result

    @property
    def causes(self) -> tuple[str, ...]:
        """Of every row the name of its member of `RESULTS`."""
        return tuple(CAUSES[number] for number in np.asarray(self.result._value).tolist())

    def within(self, limits: Mapping[str, Limits]) -> Yield | None:
        """Which part keeps all limits, of the actuators whose simulations did not fail; `None` where all have.

        **Arguments:** `limits`: lower and upper end by output, in its SI unit, either `None`.

        **Raises:** `InputError` for a name that is none of the outputs, or that of a curve.
        """
        curves = {output.name for output in self.outputs if output.axis} & limits.keys()
        if curves:
            raise InputError(
                f"a limit is one of a number, but '{min(curves)}' is a curve; limit a number of it", "limits"
            )
        kept = [keeps(self[name], ends) for name, ends in limits.items()]
        return yield_of(np.all([~self.failed, *kept], axis=0)[~self.failed])

    def _title(self) -> str:
        counts = Counter(cause for cause in self.causes if cause != CAUSES[0])
        why = ", ".join(f"{count} {cause}" for cause, count in counts.items())
        curves = sum(bool(output.axis) for output in self.outputs)
        return f"{len(self.matrix)} samples, {int(self.failed.sum())} failed{f' ({why})' * bool(why)}, {curves} curves"

    def _tables(self) -> list[Cells]:
        rows = [["output", "unit", "mean", "deviation", *(f"{share:.0%}" for share in SHARES)]]
        for output in self.outputs:
            if not output.axis:
                found = describe(self[output.name], SHARES)
                figures = [found.mean, found.deviation, *found.quantiles]
                rows.append([output.name, output.unit, *(f"{figure:.5g}" for figure in figures)])
        return [rows]


@dataclasses.dataclass(frozen=True, eq=False)
class Gradients(HasEnds, OutputTable):
    """Derivatives of outputs with respect to some factors, whose matrix is `(rows, columns, factors)`; all of a
    simulation that failed are NaN, and `result` says of every row how it ended."""

    result: RESULTS


class Description(NamedTuple):
    """What is said of a number over many samples; NaN where too few have it."""

    defined: int
    """Samples that have it."""
    mean: float
    deviation: float
    quantiles: Float[np.ndarray, " shares"]


def describe(values: Float[np.ndarray, " rows"], shares: Sequence[float] = SHARES) -> Description:
    """Mean, standard deviation, and quantiles at `shares`, of the values that are finite."""
    defined = values[np.isfinite(values)]
    count = len(defined)
    return Description(
        count,
        float(defined.mean()) if count else math.nan,
        float(defined.std(ddof=1)) if count > 1 else math.nan,
        np.quantile(defined, shares) if count else np.full(len(shares), math.nan),
    )


def column_names(outputs: Sequence[Output]) -> tuple[str, ...]:
    """Outputs, with a number for every point of a curve."""
    names: list[str] = []
    for output in outputs:
        names += [f"{output.name}[{point}]" for point in range(output.size)] if output.axis else [output.name]
    return tuple(names)
