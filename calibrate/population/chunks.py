"""Results of many samples on disk, written chunk by chunk as they come, so that memory is bounded and a run resumes."""

import dataclasses
import math
import os
import pathlib
import shutil
from collections.abc import Iterable, Iterator

import numpy as np

from vgtjax.population import Results

FOLDER = ".chunks"


@dataclasses.dataclass(frozen=True)
class ChunkStore:
    """Rows of results in files of `lanes` rows each; `columns` names what a row holds.

    All columns are kept of chunks that begin before row `long`, the first `short` of them of all others.
    """

    folder: pathlib.Path
    columns: tuple[str, ...]
    rows: int
    lanes: int
    short: int
    long: int

    @property
    def count(self) -> int:
        """Number of chunks."""
        return math.ceil(self.rows / self.lanes)

    def span(self, number: int) -> tuple[int, int]:
        """First row of a chunk, and the one after its last."""
        return number * self.lanes, min(self.rows, (number + 1) * self.lanes)

    def size(self, number: int) -> int:
        """Rows of a chunk."""
        begin, end = self.span(number)
        return end - begin

    def missing(self) -> np.ndarray:
        """Which chunks are still to be computed."""
        return np.array([not self._readable(number) for number in range(self.count)])

    def save(self, number: int, results: Results) -> None:
        """Writes a chunk whole or not at all; column by column, so that one of them can be read alone."""
        kept = len(self.columns) if self.span(number)[0] < self.long else self.short
        content = np.vstack([results.failed[None].astype(float), results.outputs.T[:kept]])
        path = self._path(number)
        path.parent.mkdir(exist_ok=True)
        temporary = path.with_suffix(".new")
        with temporary.open("wb") as file:
            np.save(file, content)
        os.replace(temporary, path)

    def failed(self) -> np.ndarray:
        """Rows whose simulation failed."""
        return np.flatnonzero(np.concatenate(list(self._each(0))))

    def column(self, name: str) -> np.ndarray:
        """One column of all rows."""
        return np.concatenate(list(self._each(1 + self.columns.index(name))))

    def table(self, names: Iterable[str], begin: int = 0, end: int | None = None) -> np.ndarray:
        """Columns of a range of rows, `(rows, columns)`."""
        places = [1 + self.columns.index(name) for name in names]
        end = self.rows if end is None else end
        parts = []
        for number in range(begin // self.lanes, math.ceil(end / self.lanes)):
            first, last = self.span(number)
            content = np.load(self._path(number), mmap_mode="r")
            parts.append(np.array(content[places, max(begin - first, 0) : min(end, last) - first]).T)
        return np.concatenate(parts)

    def remove(self) -> None:
        """Removes all chunks, once what was wanted of them is written elsewhere."""
        shutil.rmtree(self.folder / FOLDER)

    def _each(self, place: int) -> Iterator[np.ndarray]:
        for number in range(self.count):
            yield np.array(np.load(self._path(number), mmap_mode="r")[place])

    def _readable(self, number: int) -> bool:
        """Whether a chunk is there; one that a full disk has cut short is not."""
        try:
            np.load(self._path(number), mmap_mode="r")
        except (OSError, ValueError, EOFError):
            return False
        return True

    def _path(self, number: int) -> pathlib.Path:
        return self.folder / FOLDER / f"{number:06d}.npy"
