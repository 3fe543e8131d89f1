"""Linear least squares in NumPy: the solution, its covariance, and which unknowns are estimable."""

import dataclasses
import functools
import math
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

Columns = Float[np.ndarray, "rows unknowns"]

NULL = 1e-9
"""Singular values below this part of the largest are no information: an exact Jacobian in double precision computes
a true null direction to about 1e-13, and the weakest real direction of our simulated traces lies near 1e-4."""
NULL_OF_GRAM = 1e-12
"""The same for eigenvalues of a product of columns with themselves, which are squares of singular values: rounding
leaves 1e-16 of the largest, so that `NULL` squared can't be seen, and the weakest real direction lies near 1e-8."""
FAINT = 1e-6
"""Deviations of the noise, all samples together, by which a unit of a coordinate (its logarithm, or a usual size) must
move signals to be information: less is rounding, and an error of a million says nothing."""
IN_NULL = 1e-6
"""Part of a null direction, for columns of unit length, from which an unknown belongs to it and is not estimable. Of
our actuators the smallest real part is 7e-5 (the mass, where the area is free as well), rounding leaves 1e-12."""
WORST_CONDITION = 1e6
"""Of columns of unit length, up to which squaring them loses nothing that a second pass does not bring back."""
NORMAL_95 = 1.959964
"""Standard errors on either side that hold 95 % of a normal distribution."""
FACTOR = 10.0
"""To either side, what the 95 % interval of a determined positive value may reach."""
VAGUE = math.log(FACTOR) / NORMAL_95
"""Standard error of a logarithm beyond which the 95 % interval goes farther than `FACTOR` to either side: the
traces don't tell such a value, and what a linear model says over such a distance is no word about them."""
BORDERLINE = VAGUE / 2
"""Standard error of a logarithm beyond which the linear model alone does not decide that a value is determined: its
interval is a factor of three to either side, over which derivatives of other places say other things."""
BLOCK = 2048
"""Rows of a tall matrix that are worked on at a time: half a megabyte."""
HUBER = 2.0
"""Standard deviations beyond which a residual counts by its size instead of its square."""


@dataclasses.dataclass(frozen=True, eq=False)
class LeastSquares:
    """The solution of `columns @ values = target`, and what the equations say of it.

    `covariance` is that of rows with noise of size one unless it was `scaled`, with zeros for what is not `estimable`.
    `null_directions` are the combinations of unknowns, for columns of unit length, that change nothing, and `estimable`
    is what is in none of them. `scale` is the variance of what remains per degree of freedom, `gain` how much the
    solution lowers the sum of squares.
    """

    values: Float[np.ndarray, " unknowns"]
    covariance: Float[np.ndarray, "unknowns unknowns"]
    estimable: Bool[np.ndarray, " unknowns"]
    null_directions: Float[np.ndarray, "directions unknowns"]
    scale: float
    gain: float

    @property
    def rank(self) -> int:
        """Number of directions that the equations determine."""
        return len(self.values) - len(self.null_directions)

    @property
    def std_errors(self) -> Float[np.ndarray, " unknowns"]:
        """Standard errors of the values; NaN for what is not estimable."""
        return np.where(self.estimable, np.sqrt(np.diag(self.covariance)), np.nan)

    def determined(self, logarithms: Bool[np.ndarray, " unknowns"]) -> Bool[np.ndarray, " unknowns"]:
        """Which unknowns are estimable, and those that are `logarithms` to a factor of ten to either side at least."""
        return self.estimable & ~(logarithms & (np.nan_to_num(self.std_errors) > VAGUE))

    def borderline(self, logarithms: Bool[np.ndarray, " unknowns"]) -> Bool[np.ndarray, " unknowns"]:
        """Which of the determined ones are `logarithms` whose standard error is above `BORDERLINE`."""
        return self.determined(logarithms) & logarithms & (np.nan_to_num(self.std_errors) > BORDERLINE)

    def vague(self, logarithms: Bool[np.ndarray, " unknowns"]) -> Float[np.ndarray, "directions unknowns"]:
        """Combinations of unknowns that are logarithms, each of length one, along which one of these has a standard
        error above `VAGUE`."""
        known = logarithms[:, None] & logarithms & np.isfinite(self.covariance)
        sizes, directions = np.linalg.eigh(np.where(known, self.covariance, 0.0))
        reach = np.sqrt(np.maximum(sizes, 0.0)) * np.max(np.abs(directions), axis=0, initial=0.0)
        return directions.T[reach > VAGUE]

    def first(self, count: int) -> "LeastSquares":
        """What it says of the first unknowns, whatever the others are."""
        directions = self.null_directions[:, :count]
        return dataclasses.replace(
            self,
            values=self.values[:count],
            covariance=self.covariance[:count, :count],
            estimable=self.estimable[:count],
            null_directions=directions[np.any(directions != 0, axis=1)],
        )

    def scaled(self, scale: float) -> "LeastSquares":
        """The same solution of a fresh covariance, for rows whose noise has the variance `scale`."""
        return dataclasses.replace(self, covariance=scale * self.covariance, scale=scale)


def least_squares(columns: Columns, target: Float[np.ndarray, " rows"], inflation: float = np.inf) -> LeastSquares:
    """The solution of smallest size in columns of unit length, by QR and a singular value decomposition.

    Units of the columns don't matter. Null directions take no part: what is estimable keeps the error that it has
    without them.

    **Arguments:** `columns` and `target` in units of the rows' noise; `inflation`: an unknown whose variance the other
    columns multiply by more than that is not estimable either, for columns with errors of their own.
    """
    inverse, projector, singular, directions = _factors(columns)
    rank = inverse.shape[1]
    projected = projector.T @ target
    values = inverse @ projected
    left = target - columns @ values
    outside = np.linalg.norm(directions[rank:], axis=0) < IN_NULL
    estimable = outside & (_inflation(singular, directions) < inflation)
    return LeastSquares(
        values,
        np.where(estimable[:, None] & estimable, inverse @ inverse.T, 0.0),
        estimable,
        directions[rank:],
        float(left @ left) / max(len(target) - rank, 1),
        float(projected @ projected),
    )


def pseudo_inverse(columns: Columns) -> Float[np.ndarray, "unknowns rows"]:
    """Of columns whose units don't matter, without what is null."""
    inverse, projector, _, _ = _factors(columns)
    return np.asarray(inverse @ projector.T)


def _factors(columns: Columns) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """`inverse @ projector.T` is the pseudo-inverse for columns of unit length, of which come the singular values and
    directions as well: those behind the rank are null."""
    lengths = np.linalg.norm(columns, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    basis, triangle = np.linalg.qr(columns / lengths)
    rotation, singular, directions = np.linalg.svd(triangle)
    rank = int(np.sum(singular > NULL * np.max(singular, initial=0.0)))
    inverse = directions[:rank].T / singular[:rank] / lengths[:, None]
    return inverse, basis @ rotation[:, :rank], singular, directions


def estimate_uncertainty(
    residuals: Float[np.ndarray, " rows"], columns: Columns, count: int, known: int = 0
) -> LeastSquares:
    """Uncertainty at the minimum of a nonlinear least squares: the linear problem there, scaled by what remains.

    **Arguments:** `residuals` in units of the assumed noise, and `columns`, their Jacobian with respect to coordinates
    of comparable size; `count`: independent measurements (padding and eliminated offsets don't count); `known`: rows
    at the end that measure nothing, as they are known beforehand: their noise is one, whatever remains of the others.
    """
    lengths = np.linalg.norm(columns, axis=0)
    # A column this short, or so much shorter than the longest, moves nothing that a sensor could see.
    columns = np.where(lengths > max(FAINT, NULL * np.max(lengths, initial=0.0)), columns, 0.0)
    found = least_squares(columns, residuals)
    measured = slice(len(residuals) - known)
    scale = float(residuals[measured] @ residuals[measured]) / max(count - found.rank, 1)
    if not known:
        return found.scaled(scale)
    inverse = _factors(columns)[0]
    moved = columns @ inverse @ inverse.T * found.estimable
    moved[measured] *= np.sqrt(scale)
    return dataclasses.replace(found, covariance=moved.T @ moved, scale=scale)


def root_of(covariance: Float[np.ndarray, "unknowns unknowns"]) -> Float[np.ndarray, "unknowns directions"]:
    """A factor whose product with its transpose is a covariance, whatever the units; rows of zeros where that has none.

    By the correlation: variances here lie 20 orders apart, and those of a sum far below those of its parts.
    """
    deviations = np.sqrt(np.diag(covariance))
    sizes = np.where(deviations > 0, deviations, 1.0)
    parts, ways = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    return deviations[:, None] * ways * np.sqrt(np.maximum(parts, 0.0))


def reduce_rows(
    residuals: Float[np.ndarray, " rows"], columns: Columns
) -> tuple[Float[np.ndarray, " few"], Float[np.ndarray, "few unknowns"]]:
    """The same least-squares problem in as many rows as there are unknowns, and one for what no unknown explains: the
    triangle of a QR factorisation of the columns and, behind them, the residuals.

    A column that is not finite is of no use, and becomes zero.

    By Cholesky's factors, twice, which is as exact as Householder's reflections while the columns, of unit length, have
    a condition below 1e8 (Yamamoto et al., 2015), in a third of LAPACK's time; by reflections where it might not be.
    """
    try:
        triangle = _cholesky_factor(residuals, columns)
    except np.linalg.LinAlgError:
        triangle = np.asarray(np.linalg.qr(np.column_stack([finite_columns(columns), residuals]), mode="r"))
    return triangle[:, -1], triangle[:, :-1]


def _cholesky_factor(residuals: Float[np.ndarray, " rows"], columns: Columns) -> Float[np.ndarray, "few all"]:
    """The triangle of a QR factorisation.

    **Raises:** `LinAlgError` where a column is not finite, or too near to others.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # squares of a value that ran away
        gram = _gram(_blocks(residuals, columns))
    if not np.all(np.isfinite(gram)):
        raise np.linalg.LinAlgError
    lengths = np.sqrt(np.diag(gram))
    safe = np.where(lengths > 0, lengths, 1.0)
    unused = np.diag(np.where(lengths > 0, 0.0, 1.0))
    first = np.linalg.cholesky(gram / np.outer(safe, safe) + unused).T
    if not np.linalg.cond(first) < WORST_CONDITION:
        raise np.linalg.LinAlgError
    nearly = np.linalg.inv(first) / safe[:, None]
    again = _gram(block @ nearly for block in _blocks(residuals, columns))
    return np.linalg.cholesky(again + unused).T @ first * lengths


def _blocks(residuals: Float[np.ndarray, " rows"], columns: Columns) -> Iterator[Float[np.ndarray, "rows all"]]:
    """Columns and, behind them, residuals, in so few rows at a time that they stay in a core's cache."""
    for begin in range(0, len(residuals), BLOCK):
        rows = slice(begin, begin + BLOCK)
        yield np.column_stack([columns[rows], residuals[rows]])


def _gram(blocks: Iterable[Float[np.ndarray, "rows all"]]) -> Float[np.ndarray, "all all"]:
    return functools.reduce(np.add, (block.T @ block for block in blocks))


def finite_columns(columns: Columns) -> Columns:
    """Columns with zeros for those whose length is not finite: of 1e160, say, where a simulation explodes."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.einsum("ij,ij->j", columns, columns)
    return np.where(np.isfinite(squares), columns, 0.0)


def determined_within(columns: Columns, scale: float, worst: float) -> Bool[np.ndarray, " unknowns"]:
    """Which unknowns are determined well enough, when those that aren't are held one after another, the worst first.

    **Arguments:** `columns` with respect to unknowns of comparable size, such as logarithms; `scale` multiplies their
    standard errors; `worst` is the largest that is good enough.
    """
    lengths: np.ndarray = np.linalg.norm(columns, axis=0)
    free = lengths > 0  # a column that is not finite is of no use either
    triangle = np.asarray(np.linalg.qr(np.where(free, columns, 0.0), mode="r"))
    while np.any(free):
        chosen = np.flatnonzero(free)
        _, singular, directions = np.linalg.svd(triangle[:, chosen] / lengths[chosen])
        errors = scale * np.sqrt(_inflation(singular, directions)) / lengths[chosen]
        if np.max(errors) <= worst:
            break
        free[chosen[np.argmax(errors)]] = False
    return free


def _inflation(singular: np.ndarray, directions: np.ndarray) -> Float[np.ndarray, " unknowns"]:
    """By how much each unknown's variance exceeds that with all others known, for columns of unit length."""
    floor = NULL * np.max(singular, initial=0.0)
    sizes = np.append(singular, np.zeros(len(directions) - len(singular)))
    return np.sum((directions / np.maximum(sizes, floor)[:, None]) ** 2, axis=0) if floor > 0 else sizes + np.inf


# -- residuals that are not independent, or not normal -----------------------------------------------------------------


def clustered_gram(
    residuals: Float[np.ndarray, " rows"], columns: Columns, groups: Int[np.ndarray, " rows"]
) -> Float[np.ndarray, "unknowns unknowns"]:
    """Variance of `columns.T @ residuals` if only rows of different groups are independent (Liang and Zeger, 1986)."""
    members = np.unique(groups, return_inverse=True)[1]
    scores = np.zeros((int(members.max()) + 1, columns.shape[1]))
    np.add.at(scores, members, columns * residuals[:, None])
    return scores.T @ scores * (len(scores) / max(len(scores) - columns.shape[1], 1))


def windowed_gram(
    scores: Float[np.ndarray, "rows unknowns"], owner: Int[np.ndarray, " rows"], lengths: Int[np.ndarray, " owners"]
) -> Float[np.ndarray, "unknowns unknowns"]:
    """Variance of the sum of scores (residuals times their columns) that are correlated in time within each owner.

    By sums over all windows of an owner's number of rows, of `lengths`, which is Bartlett's kernel (Newey and West,
    1987). What the fit of as many unknowns has taken away from the residuals is given back.
    """
    unknowns, windows = scores.shape[1], float(np.sum(1 / lengths[owner]))
    gram = np.zeros((unknowns, unknowns))
    for each in np.unique(owner):
        length = int(lengths[each])
        padded = np.pad(scores[owner == each], ((length, length), (0, 0)))
        ahead = np.cumsum(padded, axis=0)
        sums = ahead[length:] - ahead[:-length]
        gram += sums.T @ sums / length
    return gram * windows / max(windows - unknowns, 1.0)


def clustered_errors(
    residuals: Float[np.ndarray, " rows"], columns: Columns, groups: Int[np.ndarray, " rows"]
) -> Float[np.ndarray, " unknowns"]:
    """Standard errors of a least-squares solution whose residuals are correlated within groups of neighbours: by sums
    over groups, or the usual ones enlarged, the larger of the two. NaN for what is not estimable."""
    found = least_squares(columns, residuals)
    bread, usual = found.covariance, np.diag(found.covariance)
    robust = np.diag(bread @ clustered_gram(residuals, columns, groups) @ bread)
    sums = np.bincount(np.unique(groups, return_inverse=True)[1], residuals)
    square = float(residuals @ residuals)
    together = max(1.0, float(sums @ sums) / max(square, 1e-300))
    freedom = max(np.count_nonzero(residuals) - columns.shape[1], 1)
    errors = np.sqrt(np.maximum(robust, together * square / freedom * usual))
    return np.where(found.estimable, errors, np.nan)


def error_factor(columns: Columns, errors: Float[np.ndarray, " unknowns"]) -> float:
    """By how much standard errors exceed those of independent residuals of size one, in the median."""
    usual = least_squares(columns, np.zeros(len(columns))).std_errors
    return float(np.nanmedian(errors / usual)) if np.any(np.isfinite(usual)) else 1.0


def huber_weights(residuals: Float[np.ndarray, " rows"], deviation: float) -> Float[np.ndarray, " rows"]:
    """Factors of rows that make residuals beyond `HUBER` deviations count by their size instead of their square."""
    return np.sqrt(np.minimum(1.0, HUBER * deviation / np.maximum(np.abs(residuals), 1e-300)))
