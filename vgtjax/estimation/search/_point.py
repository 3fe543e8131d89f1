"""A problem linearised at a point, and how that is brought along when the point moves."""

import dataclasses
import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..._errors import SimulationError
from ..._kept import keep_compiled
from ..._types import Coordinates
from .._least_squares import LeastSquares, estimate_uncertainty, finite_columns, reduce_rows
from ..derivatives import Computation, Evaluated, ask
from ..measurements import FitProblem
from ._slopes import Slopes

WEAK = 1e-7
"""Singular values below this part of the largest, for columns of unit length, that a secant leaves out of its basis."""
STIFF = 1e4
"""Times a sensor's noise that a combination of coordinates that is held would cost for each unit that it moves by."""
_DESCENT: optx.DampedNewtonDescent = optx.DampedNewtonDescent()


@keep_compiled
def _damped_steps(
    residuals: Float[Array, " rows"], columns: Float[Array, "rows coordinates"], sizes: Float[Array, " sizes"]
) -> Float[Array, "sizes coordinates"]:
    like = jnp.zeros(columns.shape[1])
    info = optx.FunctionInfo.ResidualJac(residuals, lx.MatrixLinearOperator(columns))

    def one(size: Array) -> Array:
        return _DESCENT.step(size, _DESCENT.query(like, info, _DESCENT.init(like, info)))[0]

    return jax.vmap(one)(sizes)


@dataclasses.dataclass(frozen=True, eq=False)
class Reduced:
    """A linear least-squares problem in few rows; `count` is how many it stands for."""

    residuals: Float[np.ndarray, " rows"]
    columns: Float[np.ndarray, "rows coordinates"]
    count: int

    def damped_steps(self, sizes: Sequence[float]) -> Float[np.ndarray, "sizes coordinates"]:
        """Steps of Levenberg and Marquardt whose damping is `1 / size` times the mean square of a residual."""
        few, columns = reduce_rows(self.residuals, self.columns)
        root = np.sqrt(self.count)
        return np.asarray(_damped_steps(*map(jnp.asarray, (few / root, columns / root, np.array(sizes, float)))))

    def promise(self, move: Coordinates) -> float:
        """By how much chi^2 would change along a move if the problem were linear."""
        moved = self.columns @ move
        return float(2 * self.residuals @ moved + moved @ moved)


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """A problem linearised: residuals and their Jacobian with respect to the coordinates, in units of the noise; the
    last `known` of them are of what is known beforehand."""

    residuals: Float[np.ndarray, " residuals"]
    columns: Float[np.ndarray, "residuals coordinates"]
    known: int = 0

    @staticmethod
    def of(problem: FitProblem, here: Coordinates, observed: Evaluated, slopes: Slopes) -> "Point":
        """A problem with what is observed at `here`; derivatives may be those of a point nearby."""
        return Point.by(problem, here, problem.everything_of(observed.observed, here), slopes)

    @staticmethod
    def by(
        problem: FitProblem, here: Coordinates, residuals: Float[np.ndarray, " residuals"], slopes: Slopes
    ) -> "Point":
        """The same with residuals that are known."""
        columns = problem.columns_of(slopes.columns, slopes.at)
        known = 0 if problem.prior is None else len(problem.prior.precision)
        if problem.prior is not None:
            columns = np.concatenate([columns, np.diag(problem.prior.precision)])
        with np.errstate(over="ignore", invalid="ignore"):  # of a search that got lost
            held = np.asarray(problem.transform.pinned(here, residuals @ columns))
        return Point(residuals, np.where(held, 0.0, columns) if np.any(held) else columns, known)

    def holding(self, combinations: Float[np.ndarray, "directions coordinates"]) -> "Point":
        """The same problem with combinations of coordinates held where they are, by a row more for each."""
        if not len(combinations):
            return self
        residuals = np.append(self.residuals, np.zeros(len(combinations)))
        columns = np.concatenate([self.columns, STIFF * combinations])
        return Point(residuals, columns, self.known + len(combinations))

    def bend(self, problem: FitProblem, here: Coordinates, slopes: Slopes) -> float:
        """By how many standard errors, over all directions, a linear step goes wrong for derivatives from elsewhere."""
        there = problem.residuals_of(slopes.evaluated.observed)
        traces = slice(len(there))
        moved = self.residuals[traces] - there
        bent, _ = reduce_rows(moved - self.columns[traces] @ (here - slopes.at), self.columns[traces])
        return float(np.linalg.norm(bent[:-1]))

    @functools.cached_property
    def reduced(self) -> Reduced:
        """The same linear problem in as many rows as there are coordinates, and one."""
        return Reduced(*reduce_rows(self.residuals, self.columns), len(self.residuals))

    def uncertainty(self, count: int) -> LeastSquares:
        """Uncertainty at the minimum by this linear problem, of `count` independent measurements."""
        if not self.known:
            return estimate_uncertainty(self.reduced.residuals, self.reduced.columns, count)
        few, columns = self._measured
        residuals = np.concatenate([few, self.residuals[-self.known :]])
        return estimate_uncertainty(residuals, np.vstack([columns, self.columns[-self.known :]]), count, self.known)

    @functools.cached_property
    def _measured(self) -> tuple[np.ndarray, np.ndarray]:
        """`reduced` without what is known beforehand."""
        return reduce_rows(self.residuals[: -self.known], self.columns[: -self.known])

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


@dataclasses.dataclass(frozen=True, eq=False)
class Secant:
    """A linear problem that learns from each move what the misfit really did along it, and forgets nothing else.

    Broyden's update (1965) with the metric of the problem itself: directions whose columns are orthogonal to those of
    the move stay as they were, whatever the units of the coordinates. `basis` spans the rows of the `reduced` problem.
    """

    basis: Float[np.ndarray, "residuals rows"]
    reduced: Reduced

    @staticmethod
    def of(point: Point) -> "Secant":
        """Nothing learned yet."""
        everything = np.column_stack([finite_columns(point.columns), point.residuals])
        few = np.column_stack([point.reduced.columns, point.reduced.residuals])
        lengths = np.linalg.norm(few, axis=0)
        lengths = np.where(lengths > 0, lengths, 1.0)
        rotation, singular, directions = np.linalg.svd(few / lengths, full_matrices=False)
        # What lies below is too weak for rounding to leave its rows orthogonal, and teaches nothing.
        strong = singular > WEAK * singular[0]
        basis = everything @ (
            directions.T * np.where(strong, 1 / np.where(strong, singular, 1.0), 0.0) / lengths[:, None]
        )
        rotated = rotation.T @ few
        return Secant(basis, Reduced(rotated[:, -1], rotated[:, :-1], len(point.residuals)))

    def moved(self, move: Coordinates, residuals: Float[np.ndarray, " residuals"]) -> "Secant":
        """The problem at the end of a move, where these are the residuals."""
        along = self.reduced.columns @ move
        unexplained = residuals - self.basis @ (self.reduced.residuals + along)
        inside = self.basis.T @ unexplained
        outside = unexplained - self.basis @ inside
        length = float(np.linalg.norm(outside))
        new = np.append(inside, length)
        padded = np.vstack([self.reduced.columns, np.zeros(len(move))])
        learned = np.outer(new, along @ self.reduced.columns / max(float(along @ along), 1e-300))
        basis = np.column_stack([self.basis, outside / max(length, 1e-300)])
        at_end = np.append(self.reduced.residuals + along, 0.0) + new
        return Secant(basis, Reduced(at_end, padded + learned, self.reduced.count))


def misfit_at(problem: FitProblem, coordinates: Coordinates) -> Computation[Float[np.ndarray, " residuals"] | None]:
    """Residuals at some coordinates and what is known of these beforehand; `None` where a simulation fails."""
    with np.errstate(over="ignore"):
        question = problem.evaluation(coordinates)
    try:
        answer = yield from ask(question)
    except SimulationError:
        return None
    if answer.failed:
        return None
    return problem.everything_of(problem.beside_edges(answer, coordinates).observed, coordinates)
