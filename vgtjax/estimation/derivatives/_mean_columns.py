"""Means of derivatives over several places, without rows that explode at one of them.

Where a rod just sticks or a plunger just hovers, derivatives at one place of five can be a thousand times those at the
others for a part of a trace; the mean is theirs alone then, and tells of a thousand times as much as is known. Slow
loops with exhaust gas have such places. A row is left out as a whole, so that a combination of parameters that
no trace depends on at any place does not show in the mean either; medians of single numbers have no such thing.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool

from ..._errors import SimulationError
from ._evaluation import Computation, Evaluated

FAR_OUT = 3.0
"""Times the median size of a row over all places from which it is left out at one."""

Columns = list[np.ndarray]
"""By bundle, what is observed by each parameter."""
Believed = list[Bool[np.ndarray, "places ..."]]
"""By bundle, which rows of which place are in a mean."""


def mean_columns(
    own: Columns,
    others: Sequence[Callable[[], Computation[Evaluated]]],
    units: Sequence[np.ndarray],
    believed: Believed | None = None,
) -> Computation[tuple[Columns, Believed]]:
    """The mean of columns at an end and at `others` around it, without those where a simulation fails, and which rows
    of which place are in it.

    **Arguments:** `others`: what is observed at a place, and its derivatives; `units` that each has, in those of `own`;
    `believed`: which rows are to be in it, as other columns of the same places have told.
    """
    found = [own]
    for asked, unit in zip(others, units, strict=True):
        try:
            there = yield from asked()
        except SimulationError:
            found.append([])
            continue
        usable = not there.failed and _as_finite(there.columns, own)
        found.append([each * unit for each in there.columns] if usable else [])
    believed = _believed(found) if believed is None else believed
    return [_mean([of[each] if of else None for of in found], rows) for each, rows in enumerate(believed)], believed


def _mean(found: Sequence[np.ndarray | None], rows: Bool[np.ndarray, "places ..."]) -> np.ndarray:
    """Over those places that have a row, at least the first."""
    own = found[0]
    assert own is not None, "the first place is where derivatives are known"
    total, count = np.zeros(own.shape), np.zeros(rows.shape[1:])
    for columns, taken in zip(found, rows, strict=True):
        if columns is not None:
            np.add(total, columns, out=total, where=taken[..., None])
            count += taken
    total /= np.maximum(count, 1)[..., None]
    total[count == 0] = own[count == 0]
    return total


def _believed(found: Sequence[Columns]) -> Believed:
    """No row that is far larger than at other places, where columns count in lengths that are usual of all places."""
    there = np.array([len(columns) > 0 for columns in found])
    with np.errstate(over="ignore", invalid="ignore"):  # of a place where derivatives explode
        squares = np.array([sum(map(_squares, columns)) for columns in found if columns])
        usual = _median(squares)
        weights = np.where((usual > 0) & np.isfinite(usual), 1 / np.where(usual > 0, usual, 1.0), 0.0)
        believed = []
        for bundle, own in enumerate(found[0]):
            rows = np.zeros((len(found), *own.shape[:-1]), bool)
            sizes = np.nan_to_num(
                [np.einsum("...j,j->...", columns[bundle] ** 2, weights) for columns in found if columns], nan=np.inf
            )
            rows[there] = sizes <= FAR_OUT**2 * _median(sizes)
            believed.append(rows)
    return believed


def _median(sizes: np.ndarray) -> np.ndarray:
    """Over places, the lower one of two: of two places the larger would never be far out else."""
    place = (len(sizes) - 1) // 2
    return np.partition(sizes, place, axis=0)[place]


def _squares(columns: np.ndarray) -> np.ndarray:
    """The sum of squares of each column."""
    return np.einsum("abcj,abcj->j", columns, columns)


def _as_finite(columns: Columns, own: Columns) -> bool:
    """Whether all columns are finite that are so at the end."""
    found, wanted = (np.isfinite(sum(np.sum(each, axis=(0, 1, 2)) for each in lists)) for lists in (columns, own))
    return bool(np.all(found | ~wanted))
