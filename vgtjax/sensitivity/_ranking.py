"""Inputs ranked for every output, all indices side by side, and a verdict on where and why they disagree."""

import dataclasses
import enum
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from .._printing import Cells, Printed
from ..parameters import unknown_name
from ._indices import Indices
from ._named import LARGEST, largest, share
from ._resampling import BootstrapInterval

THRESHOLD = 0.05
"""An input matters for an output when it makes more than this share of its variance."""


class Interval(NamedTuple):
    """One index of one input with the ends of its confidence interval."""

    value: float
    low: float
    high: float

    def above(self, threshold: float) -> bool:
        """Whether the whole interval lies above; never for NaN."""
        return self.low > threshold

    def below(self, threshold: float) -> bool:
        """Whether the whole interval lies below; never for NaN."""
        return self.high < threshold


class Verdict(enum.Enum):
    """What the indices of an input say together; the total index is the judge of the others."""

    AGREE = "all agree"
    NO_INDEX = "no index: too few complete points, or an output that does not vary"
    UNCERTAIN = "too uncertain: the interval of the total index straddles the threshold"
    ONLY_TOGETHER = "matters only together with others"
    MOSTLY_TOGETHER = "matters more together with others than alone"
    NOT_LINEAR = "linear indices miss it"
    OVERSTATED = "an index exceeds the total: inputs are not independent, or the sample is too small"
    GRADIENT_MISLEADS = "the gradient at the nominal misleads"


@dataclasses.dataclass(frozen=True)
class RankedInput:
    """One input of one output.

    `correlation` is (4.1), `regression` the squared standardised coefficient, `first` and `total` are variance-based,
    `local` is the share by the gradient at one point, NaN where none was given: all shares of the output's variance.
    `mu_star` is in units of the output.
    """

    name: str
    correlation: Interval
    regression: Interval
    first: Interval
    total: Interval
    local: Interval
    mu_star: Interval
    verdicts: tuple[Verdict, ...]


@dataclasses.dataclass(frozen=True, repr=False)
class Ranking(Printed):
    """The inputs of one output, the largest total index first; `r2` is that of the linear model.

    `ranking["diaphragm.stiffness"]` is one of them. Prints itself as a table.
    """

    output: str
    r2: float
    used: int
    inputs: tuple[RankedInput, ...]

    def __getitem__(self, name: str) -> RankedInput:
        """One input.

        **Raises:** `InputError` for a name that is none of the inputs.
        """
        return self.inputs[_place("input", name, [entry.name for entry in self.inputs])]

    def __iter__(self) -> Iterator[str]:
        """Names of the inputs."""
        return (entry.name for entry in self.inputs)

    def __contains__(self, name: object) -> bool:
        return any(entry.name == name for entry in self.inputs)

    def _title(self) -> str:
        return f"{self.output}: {self.used} points, R2 {share(self.r2)}"

    def _tables(self) -> list[Cells]:
        kinds = ("correlation", "regression", "first", "total", "local")
        rows = [["input", *kinds, "total from", "to"]]
        for entry in self.inputs:
            shares = [getattr(entry, kind).value for kind in kinds] + [entry.total.low, entry.total.high]
            rows.append([entry.name, *map(share, shares)])
        return [rows]

    def _sentences(self) -> list[str]:
        told = [entry for entry in self.inputs if entry.verdicts not in ((Verdict.AGREE,), (Verdict.NO_INDEX,))]
        return [f"{entry.name}: {explain(entry, self.r2)}" for entry in told]


@dataclasses.dataclass(frozen=True, repr=False)
class Rankings(Printed):
    """The rankings of all outputs; `rankings["hysteresis_0mbar"]` is that of one. Prints itself as a table."""

    outputs: tuple[Ranking, ...]

    def __getitem__(self, name: str) -> Ranking:
        """The ranking of one output.

        **Raises:** `InputError` for a name that is none of the outputs.
        """
        return self.outputs[_place("output", name, [ranking.output for ranking in self.outputs])]

    def __iter__(self) -> Iterator[str]:
        """Names of the outputs."""
        return (ranking.output for ranking in self.outputs)

    def __contains__(self, name: object) -> bool:
        return any(ranking.output == name for ranking in self.outputs)

    def _title(self) -> str:
        return f"{len(self.outputs)} outputs, with the inputs of the largest total indices"

    def _tables(self) -> list[Cells]:
        rows = [["output", "points", "R2", *LARGEST]]
        for ranking in self.outputs:
            totals = {entry.name: entry.total.value for entry in ranking.inputs}
            rows.append([ranking.output, str(ranking.used), share(ranking.r2), *largest(totals)])
        return [rows]


def _place(kind: str, name: str, names: list[str]) -> int:
    if name not in names:
        raise unknown_name(kind, name, names)
    return names.index(name)


def rank_inputs(
    indices: Indices,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    *,
    local: Float[np.ndarray, "outputs inputs"] | None = None,
    threshold: float = THRESHOLD,
) -> Rankings:
    """Ranks the inputs of every output; equal ones and those without an index stay in the order given.

    An index says that an input matters when its whole interval lies above `threshold`, and that it does not when the
    whole interval lies below; else it says nothing. Each [`Verdict`][] says when it is given.

    **Arguments:** `inputs`, `outputs`: names in the order of the columns, in the place of those that the indices have;
    `local`: shares by [`gradient_share`][vgtjax.sensitivity.gradient_share].

    **Raises:** `InputError` when there is not one name per column, or `local` has another shape.
    """
    shape = indices.total.value.shape
    inputs, outputs = indices.inputs if inputs is None else inputs, indices.outputs if outputs is None else outputs
    local = np.full(shape, np.nan) if local is None else np.asarray(local, dtype=float)
    for what, found in (("names", (len(outputs), len(inputs))), ("local shares", local.shape)):
        if found != shape:
            raise InputError(
                f"the {what} must be for {shape[0]} outputs and {shape[1]} inputs, but they are for {found}; "
                "give one per output and input, in the order of the columns"
            )
    rankings = []
    for row, output in enumerate(outputs):
        order = np.argsort(-indices.total.value[row], kind="stable")  # NaN comes last
        ranked = tuple(_ranked(indices, local, inputs[column], (row, int(column)), threshold) for column in order)
        rankings.append(Ranking(output, float(indices.r2.value[row]), int(indices.used[row]), ranked))
    return Rankings(tuple(rankings))


def judge(
    correlation: Interval,
    regression: Interval,
    first: Interval,
    total: Interval,
    local: Interval,
    threshold: float = THRESHOLD,
) -> tuple[Verdict, ...]:
    """All verdicts on one input, in the order of [`Verdict`][]; `AGREE` when no index contradicts the total one.

    - total is NaN: `NO_INDEX`; total says nothing: `UNCERTAIN`. Neither has company.
    - total says that it matters: `ONLY_TOGETHER` when the first-order index says it does not. Else `MOSTLY_TOGETHER`
      when the whole interval of the first-order index lies below half of that of the total index, and `NOT_LINEAR`
      when correlation or regression says that it does not matter; what has no effect alone can have no linear effect.
    - total says that it does not: `OVERSTATED` when correlation, regression or the first-order index says it does,
      which no index of independent inputs can.
    - `GRADIENT_MISLEADS` when the local share says the opposite.
    """
    if np.isnan(total.value):
        return (Verdict.NO_INDEX,)
    if total.above(threshold):
        found = _missed(correlation, regression, first, total, threshold)
        misled = local.below(threshold)
    elif total.below(threshold):
        others = (correlation, regression, first)
        found = [Verdict.OVERSTATED] if any(index.above(threshold) for index in others) else []
        misled = local.above(threshold)
    else:
        return (Verdict.UNCERTAIN,)
    found += [Verdict.GRADIENT_MISLEADS] if misled else []
    return tuple(found) or (Verdict.AGREE,)


def explain(entry: RankedInput, r2: float) -> str:
    """The verdicts on an input in words, with the numbers that they rest on."""
    total, first, local = entry.total, entry.first, entry.local
    numbers = {
        Verdict.UNCERTAIN: f"{total.low:.2g} to {total.high:.2g}",
        Verdict.ONLY_TOGETHER: f"total {total.value:.2g}, first order {first.value:.2g}",
        Verdict.MOSTLY_TOGETHER: f"total {total.value:.2g}, first order {first.value:.2g}",
        Verdict.NOT_LINEAR: f"R2 = {r2:.2f}",
        Verdict.OVERSTATED: f"total {total.value:.2g}, correlation {entry.correlation.value:.2g}, "
        f"regression {entry.regression.value:.2g}, first order {first.value:.2g}",
        Verdict.GRADIENT_MISLEADS: f"{local.value:.2g} instead of {total.value:.2g}",
    }
    return "; ".join(
        f"{verdict.value} ({numbers[verdict]})" if verdict in numbers else verdict.value for verdict in entry.verdicts
    )


def _missed(
    correlation: Interval, regression: Interval, first: Interval, total: Interval, threshold: float
) -> list[Verdict]:
    if first.below(threshold):
        return [Verdict.ONLY_TOGETHER]
    found = [Verdict.MOSTLY_TOGETHER] if first.below(total.low / 2) else []
    if correlation.below(threshold) or regression.below(threshold):
        found.append(Verdict.NOT_LINEAR)
    return found


def _ranked(indices: Indices, local: np.ndarray, name: str, place: tuple[int, int], threshold: float) -> RankedInput:
    shares = {
        "correlation": _interval(indices.correlation, place),
        "regression": _squared(_interval(indices.regression, place)),
        "first": _interval(indices.first, place),
        "total": _interval(indices.total, place),
        "local": Interval(*[float(local[place])] * 3),
    }
    verdicts = judge(**shares, threshold=threshold)
    return RankedInput(name, **shares, mu_star=_interval(indices.mu_star, place), verdicts=verdicts)


def _interval(estimate: BootstrapInterval, place: tuple[int, int]) -> Interval:
    return Interval(float(estimate.value[place]), float(estimate.low[place]), float(estimate.high[place]))


def _squared(signed: Interval) -> Interval:
    """Interval of the square, from zero where the sign is uncertain."""
    ends = sorted((signed.low**2, signed.high**2))
    return Interval(signed.value**2, 0.0 if signed.low <= 0 <= signed.high else ends[0], ends[1])
