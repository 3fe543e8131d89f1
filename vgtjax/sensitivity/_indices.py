"""All indices of all outputs from one sample, with intervals, whatever rows are missing."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from .._errors import InputError
from .._printing import Cells, Printed
from ._correlation import squared_correlation
from ._design import RadialDesign
from ._morris import elementary_effects
from ._named import LARGEST, NamedIntervals, curve_of, largest, names_or_numbers, place_of, share
from ._regression import regress
from ._resampling import Statistics, bootstrap
from ._sobol import first_order, total_order

FEWEST_POINTS = 16
"""Complete points; resampling fewer says nothing about the ends of an interval."""
_BLOCK = 2**22
"""Numbers that are worked on at a time: 32 MiB, of which there are a few copies."""

AnyIndices = TypeVar("AnyIndices", bound="LinearIndices")
Columns = Int[np.ndarray, " columns"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class LinearIndices(Printed):
    """Indices of a linear model of a sample, each read by name: `indices.r2["hysteresis_0mbar"]`. Prints itself.

    `correlation` is the thesis's index (4.1), `regression` the signed standardised coefficient, both `(outputs,
    inputs)`; `r2` and `adjusted_r2` `(outputs,)`; `used` is the number of complete points behind each output.
    """

    correlation: NamedIntervals
    regression: NamedIntervals
    r2: NamedIntervals
    adjusted_r2: NamedIntervals
    used: Int[np.ndarray, " outputs"]
    _leading: ClassVar[str] = "correlation"
    """The index by which outputs are printed."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the rows; those of the points of a curve are numbered, `name[0]`, `name[1]`, ..."""
        return self.correlation.outputs

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.correlation.inputs

    def place(self, output: str) -> slice:
        """Rows of an output, a number's one or all of a curve.

        **Raises:** `InputError` for a name that is none of the outputs.
        """
        place = place_of("output", output, self.outputs)
        return place if isinstance(place, slice) else slice(place, place + 1)

    def select(self: AnyIndices, outputs: Sequence[str]) -> AnyIndices:
        """The indices of some outputs.

        **Raises:** `InputError` for a name that is none of the outputs.
        """
        rows = [row for name in outputs for row in range(len(self.outputs))[self.place(name)]]
        return _each(lambda values: values[rows], self)

    @classmethod
    def joined(cls: type[AnyIndices], parts: Sequence[AnyIndices]) -> AnyIndices:
        """The indices of all outputs, from those of some each."""
        return _each(lambda *blocks: np.concatenate(blocks), *parts)

    def _title(self) -> str:
        numbers = [name for name in self.outputs if curve_of(name) == name]
        curves = len({curve_of(name) for name in self.outputs}.difference(numbers))
        return f"{self._leading} index of {len(numbers)} outputs and {curves} curves by {len(self.inputs)} inputs"

    def _tables(self) -> list[Cells]:
        rows: list[list[str]] = [["output", "points", "R2", *LARGEST]]
        for row, name in enumerate(self.outputs):
            if curve_of(name) == name:
                shares = dict(zip(self.inputs, getattr(self, self._leading).value[row].tolist(), strict=True))
                rows.append([name, str(self.used[row]), share(float(self.r2.value[row])), *largest(shares)])
        return [rows]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Indices(LinearIndices):
    """All indices of a radial design, each read by name: `indices.total["hysteresis_0mbar", "diaphragm.area"]`.

    Those of a linear model as in [`LinearIndices`][]; `first` and `total` are variance-based, `mu`, `mu_star` and
    `sigma` statistics of elementary effects, all `(outputs, inputs)`; `used` counts complete base points.
    """

    first: NamedIntervals
    total: NamedIntervals
    mu: NamedIntervals
    mu_star: NamedIntervals
    sigma: NamedIntervals
    _leading: ClassVar[str] = "total"


def analyse(
    design: RadialDesign,
    x: Float[np.ndarray, "rows inputs"],
    y: Float[np.ndarray, "... outputs"],
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    replicates: int = 200,
    level: float = 0.95,
    seed: int = 0,
) -> Indices:
    """All indices of a radial design by the same simulations.

    A base point with any row that is not finite in an output is left out of that output, and of no other. An output
    with fewer than `FEWEST_POINTS` complete base points gets NaN, and so do the shares of one that is constant.
    Correlation and regression use all rows, whose sampling error is about half of that of A and B alone.

    **Arguments:**

    - `x`: the inputs that were simulated, physical or transformed; one column per dimension of the design.
    - `y`: the outputs; any number of columns, such as all samples of a trace.
    - `inputs`, `outputs`: names in the order of the columns, as `population.factors.entries` and `results.columns`
      are; numbered ones where none are given.
    - `replicates`, `level`, `seed`: of the [`bootstrap`][vgtjax.sensitivity.bootstrap], by base points.

    **Raises:** `InputError` when the shapes don't fit the design, there is not one name per column, or an input is not
    finite.
    """
    x, y = _checked(x, y)
    if x.shape[1] != design.dimensions:
        raise InputError(
            f"x must have a column for each of the {design.dimensions} inputs of the design, but it has {x.shape[1]}; "
            "give the inputs in the order of the design"
        )
    names = names_or_numbers("output", outputs, y.shape[1]), names_or_numbers("input", inputs, x.shape[1])
    grouped_x, grouped_y = design.group(x), design.group(y)
    u_a, u_b = design.base_points(0, design.base)

    def build(points: np.ndarray, columns: Columns) -> Statistics:
        return _radial_statistics(
            (u_a[points], u_b[points]), grouped_x[points], grouped_y[np.ix_(points, np.arange(design.members), columns)]
        )

    complete = np.isfinite(grouped_y).all(axis=1)
    return Indices(**_estimate(Indices, build, complete, names, design.members, replicates, level, seed))


def analyse_linear(
    x: Float[np.ndarray, "rows inputs"],
    y: Float[np.ndarray, "... outputs"],
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    replicates: int = 200,
    level: float = 0.95,
    seed: int = 0,
) -> LinearIndices:
    """Correlation (4.1) and regression of any sample whose rows were drawn one by one; the rest as in [`analyse`][].

    **Raises:** `InputError` when `x` and `y` don't have the same rows, there is not one name per column, or an input
    is not finite.
    """
    x, y = _checked(x, y)
    names = names_or_numbers("output", outputs, y.shape[1]), names_or_numbers("input", inputs, x.shape[1])

    def build(points: np.ndarray, columns: Columns) -> Statistics:
        chosen_x, chosen_y = x[points], y[np.ix_(points, columns)]
        return lambda weights: _linear_statistics(chosen_x, chosen_y, weights)

    return LinearIndices(**_estimate(LinearIndices, build, np.isfinite(y), names, 1, replicates, level, seed))


def _checked(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if x.ndim != 2 or y.ndim != 2 or len(x) != len(y):
        raise InputError(
            f"x and y must be tables of the same rows, but their shapes are {x.shape} and {y.shape}; give one row per "
            "simulation and one column per input or output"
        )
    if not np.all(np.isfinite(x)):
        row, column = np.argwhere(~np.isfinite(x))[0]
        raise InputError(
            f"every input must be finite, but row {row}, column {column} of x is {x[row, column]}; mark a failed "
            "simulation by outputs that are NaN"
        )
    return x, y


def _linear_statistics(x: np.ndarray, y: np.ndarray, weights: np.ndarray) -> dict[str, np.ndarray]:
    fit = regress(x, y, weights)
    return {
        "correlation": squared_correlation(x, y, weights),
        "regression": fit.coefficients,
        "r2": fit.r2,
        "adjusted_r2": fit.adjusted_r2,
    }


def _radial_statistics(
    u: tuple[np.ndarray, np.ndarray],
    x: Float[np.ndarray, "base members inputs"],
    y: Float[np.ndarray, "base members outputs"],
) -> Statistics:
    a, ab, b = y[:, 0], y[:, 1:-1], y[:, -1]

    def statistics(weights: np.ndarray) -> dict[str, np.ndarray]:
        effects = elementary_effects(*u, a, ab, weights)
        return {
            **_linear_statistics(x, y, weights),
            "first": first_order(a, ab, b, weights),
            "total": total_order(a, ab, b, weights),
            "mu": effects.mu,
            "mu_star": effects.mu_star,
            "sigma": effects.sigma,
        }

    return statistics


def _estimate(
    kind: type,
    build: Callable[[np.ndarray, Columns], Statistics],
    complete: Bool[np.ndarray, "points outputs"],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    members: int,
    replicates: int,
    level: float,
    seed: int,
) -> dict[str, Any]:
    """All fields of `kind`: NaN, filled in for outputs that have enough complete points, some outputs at a time.

    `names` are those of outputs and inputs, `members` the rows per point; with the inputs they determine the memory
    that an output takes.
    """
    outputs, inputs = names
    result: dict[str, Any] = {}
    kinds = [field.name for field in dataclasses.fields(kind) if field.name != "used"]
    for each in kinds:
        of_inputs = () if each.endswith("r2") else inputs
        shape = (len(outputs), len(inputs)) if of_inputs else (len(outputs),)
        value, low, high = np.full((3, *shape), np.nan)
        result[each] = NamedIntervals(value, low, high, outputs, of_inputs)
    for points, group in complete_groups(complete):
        if len(points) < FEWEST_POINTS:
            continue
        together = max(1, _BLOCK // max(len(points) * members, len(kinds) * replicates * len(inputs)))
        for columns in np.split(group, range(together, len(group), together)):
            found = bootstrap(build(points, columns), len(points), replicates=replicates, level=level, seed=seed)
            for name, estimate in found.items():
                for end in ("value", "low", "high"):
                    getattr(result[name], end)[columns] = getattr(estimate, end)
    return {**result, "used": np.sum(complete, axis=0)}


def _each(change: Callable[..., np.ndarray], *indices: AnyIndices) -> AnyIndices:
    """Indices made from others array by array, the names of their rows as well."""

    def changed(*values: Any) -> Any:
        if isinstance(values[0], np.ndarray):
            return change(*values)
        ends = zip(*[(each.value, each.low, each.high) for each in values], strict=True)
        outputs = change(*[np.array(each.outputs) for each in values]).tolist()
        value, low, high = (change(*end) for end in ends)
        return NamedIntervals(value, low, high, tuple(outputs), values[0].inputs)

    names = [field.name for field in dataclasses.fields(indices[0])]
    return type(indices[0])(**{name: changed(*[getattr(each, name) for each in indices]) for name in names})


def complete_groups(
    complete: Bool[np.ndarray, "points outputs"],
) -> Iterator[tuple[Int[np.ndarray, " used"], Int[np.ndarray, " columns"]]]:
    """Outputs that have the same complete points, with those points; every output once."""
    patterns, group = np.unique(complete, axis=1, return_inverse=True)
    for number, pattern in enumerate(patterns.T):
        yield np.flatnonzero(pattern), np.flatnonzero(group.ravel() == number)
