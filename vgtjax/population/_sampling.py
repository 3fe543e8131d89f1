"""Space-filling samples for Monte Carlo: Sobol' points and latin hypercubes, made slice by slice."""

import abc
import dataclasses

import numpy as np
import scipy
from jaxtyping import Float

from .._errors import InputError
from ._permutation import ROUNDS, permute, random_keys, random_words

MOST_ROWS = 2**30
"""A sample has no more base points than this: a 30-bit Sobol' sequence repeats itself after them."""
BITS = 30
"""Of a Sobol' point."""
JITTER_BITS = 20
"""Of the place within a stratum: with 30 bits of strata, sums and quotients still round to the inside."""


class Sample(abc.ABC):
    """Points of the open unit cube, addressed by their row, so that a batch can be made where it is simulated.

    A row has the same bits whatever slice it is asked for in, on any machine and in any order. No coordinate is ever 0
    or 1, so that the quantile of any distribution is finite there.
    """

    dimensions: int

    @property
    @abc.abstractmethod
    def rows(self) -> int:
        """Number of points."""

    @abc.abstractmethod
    def _draw(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        """The points of rows that are known to exist."""

    def points(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        """Rows `begin` to `end` (exclusive), in memory proportional to their number.

        **Raises:** `InputError` when there are no such rows.
        """
        if not 0 <= begin <= end <= self.rows:
            raise InputError(
                f"rows must lie between 0 and {self.rows}, but {begin} to {end} were asked for; "
                "ask for fewer, or for a larger sample"
            )
        return self._draw(begin, end)


def check_size(what: str, value: int, most: int) -> None:
    """Refuses sizes that are not between one and `most`."""
    if not 1 <= value <= most:
        raise InputError(f"{what} must be between 1 and {most}, but it is {value}; choose one in that range")


def sobol_points(dimensions: int, seed: int, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
    """Points `begin` to `end` of a scrambled Sobol' sequence (Joe and Kuo, 2008), centred in their cells."""
    engine = scipy.stats.qmc.Sobol(dimensions, scramble=True, bits=BITS, rng=np.random.default_rng(seed))
    parts = []
    if begin == 0 and end > 0:
        # SciPy warns when a first draw is no power of two; a slice is no claim about the size of the whole.
        parts.append(engine.random(1))
    elif begin > 0:
        engine.fast_forward(begin)
    parts.append(engine.random(end - begin - len(parts)) if end > begin else np.empty((0, dimensions)))
    return np.concatenate(parts) + 2.0 ** -(BITS + 1)


@dataclasses.dataclass(frozen=True)
class _SizedSample(Sample):
    dimensions: int
    size: int
    seed: int

    @property
    def rows(self) -> int:
        """Number of points."""
        return self.size


@dataclasses.dataclass(frozen=True)
class SobolSample(_SizedSample):
    """The first `size` points of a scrambled Sobol' sequence; powers of two fill space best.

    **Raises:** `InputError` for more than 21201 dimensions or `2^30` points.
    """

    def __post_init__(self) -> None:
        check_size("the number of dimensions of Sobol' points", self.dimensions, scipy.stats.qmc.Sobol.MAXDIM)
        check_size("the size of a sample", self.size, MOST_ROWS)

    def _draw(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        return sobol_points(self.dimensions, self.seed, begin, end)


@dataclasses.dataclass(frozen=True)
class LatinHypercubeSample(_SizedSample):
    """A latin hypercube: each of the `size` equal strata of every coordinate holds one point (McKay et al., 1979).

    Coordinates are at least `2^-21 / size` away from 0 and 1.

    **Raises:** `InputError` for more than `2^30` points.
    """

    def __post_init__(self) -> None:
        check_size("the number of dimensions of a latin hypercube", self.dimensions, MOST_ROWS)
        check_size("the size of a sample", self.size, MOST_ROWS)

    def _draw(self, begin: int, end: int) -> Float[np.ndarray, "points dimensions"]:
        index = np.arange(begin, end, dtype=np.uint64)
        keys = random_keys(self.seed, ROUNDS + 1, self.dimensions)
        strata = permute(index, self.size, keys[:ROUNDS])
        jitter = random_words(index[:, None], keys[ROUNDS]) >> np.uint64(64 - JITTER_BITS)
        return (strata + (jitter + 0.5) * 2.0**-JITTER_BITS) / self.size


SAMPLERS: dict[str, type[SobolSample] | type[LatinHypercubeSample]] = {
    "sobol": SobolSample,
    "latin-hypercube": LatinHypercubeSample,
}
"""What samples are called where one is chosen by name."""


def make_sample(dimensions: int, size: int, sampler: str = "sobol", seed: int = 0) -> Sample:
    """The sample of a name of `SAMPLERS`.

    **Raises:** `InputError` for another name, or a size that such a sample can't have.
    """
    if sampler not in SAMPLERS:
        raise InputError(f"sampler must be one of {', '.join(SAMPLERS)}, but it is '{sampler}'; choose one", "sampler")
    return SAMPLERS[sampler](dimensions, size, seed)
