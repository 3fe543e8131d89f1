"""Results of many samples on disk, written chunk by chunk as they come, so that memory is bounded and a run resumes."""

import dataclasses
import math
import pathlib
from collections.abc import Sequence

import numpy as np

from vgtjax.experiments import Output
from vgtjax.population import CAUSES, Results, column_names

from ..output.files import replacing

FOLDER = ".chunks"


@dataclasses.dataclass(frozen=True)
class ChunkStore:
    """Rows of results in files of `lanes` rows each, read by the names of `outputs`: `store["hysteresis_0mbar"]`.

    Numbers are kept of all rows, curves of those of chunks that begin before row `curves`.
    """

    folder: pathlib.Path
    outputs: tuple[Output, ...]
    rows: int
    lanes: int
    curves: int

    @property
    def count(self) -> int:
        """Number of chunks."""
        return math.ceil(self.rows / self.lanes)

    @property
    def numbers(self) -> tuple[Output, ...]:
        """Outputs that are no curves."""
        return tuple(output for output in self.outputs if not output.axis)

    def span(self, number: int) -> tuple[int, int]:
        """First row of a chunk, and the one after its last."""
        return number * self.lanes, min(self.rows, (number + 1) * self.lanes)

    def missing(self) -> np.ndarray:
        """Which chunks are still to be computed."""
        return np.array([not self._readable(number) for number in range(self.count)])

    def save(self, number: int, results: Results) -> None:
        """Writes a chunk whole or not at all; output by output, so that one of them can be read alone."""
        kept = results.select(self._kept(self.span(number)[0]))
        causes = [CAUSES.index(cause) for cause in results.causes]
        _write(self._path(number), np.vstack([causes, kept.matrix.T]))

    def failed(self) -> dict[int, str]:
        """Rows of which a simulation failed, with the cause."""
        chunks = [np.array(np.load(self._path(number), mmap_mode="r")[0]) for number in range(self.count)]
        causes = np.concatenate(chunks).astype(int)
        return {row: CAUSES[causes[row]] for row in np.flatnonzero(causes).tolist()}

    def __getitem__(self, name: str) -> np.ndarray:
        """One output in SI units: of all rows `(rows,)`, or a curve of the first `curves` rows `(rows, points)`."""
        (output,) = [output for output in self.outputs if output.name == name]
        if not output.axis:
            return self.matrix([output])[:, 0]
        return self.matrix([output], 0, min(self.rows, self.curves))

    def matrix(self, outputs: Sequence[Output], begin: int = 0, end: int | None = None) -> np.ndarray:
        """Outputs of a range of rows side by side, `(rows, columns)`."""
        return self.columns(column_names(outputs), begin, end)

    def columns(self, names: Sequence[str], begin: int = 0, end: int | None = None) -> np.ndarray:
        """The same of some columns of outputs, by their names."""
        end = self.rows if end is None else end
        parts = []
        for number in range(begin // self.lanes, math.ceil(end / self.lanes)):
            first, last = self.span(number)
            stored = column_names(self._kept(first))
            places = [1 + stored.index(name) for name in names]
            content = np.load(self._path(number), mmap_mode="r")
            parts.append(np.array(content[places, max(begin - first, 0) : min(end, last) - first]).T)
        return np.concatenate(parts)

    def has_slopes(self, number: int) -> bool:
        """Whether a part of the derivatives is there."""
        return _readable(self._slopes(number))

    def save_slopes(self, number: int, matrix: np.ndarray) -> None:
        """Writes a part of the derivatives, whole or not at all."""
        _write(self._slopes(number), matrix)

    def load_slopes(self, number: int) -> np.ndarray:
        """A part of the derivatives."""
        return np.asarray(np.load(self._slopes(number)))

    def _slopes(self, number: int) -> pathlib.Path:
        return self.folder / FOLDER / f"slopes_{number:06d}.npy"

    def _kept(self, row: int) -> tuple[Output, ...]:
        """What is kept in the chunk that begins at a row."""
        return self.outputs if row < self.curves else self.numbers

    def _readable(self, number: int) -> bool:
        return _readable(self._path(number))

    def _path(self, number: int) -> pathlib.Path:
        return self.folder / FOLDER / f"{number:06d}.npy"


def _write(path: pathlib.Path, content: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    with replacing(path) as new, new.open("wb") as file:
        np.save(file, content)


def _readable(path: pathlib.Path) -> bool:
    """Whether an array is there; one that a full disk has cut short is not."""
    try:
        np.load(path, mmap_mode="r")
    except (OSError, ValueError, EOFError):
        return False
    return True
