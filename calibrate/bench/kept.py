"""Rows of a long benchmark on disk, so that one that was interrupted goes on."""

import dataclasses
import json
import pathlib
from collections.abc import Callable

from ..output.files import write_json

Cells = tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class KeptRows:
    """Rows by their names, in a JSON file; `path` may be `None`: then nothing is kept.

    The file holds for one `about`, the text that says what is measured; with another one it begins anew. Changes of
    the code are not seen: delete the file after one.
    """

    path: pathlib.Path | None
    about: str

    def row(self, name: str, measure: Callable[[], Cells]) -> Cells:
        """The cells of a row, measured unless the file has them."""
        rows = self._read()
        if name not in rows:
            rows[name] = measure()
            if self.path is not None:
                write_json(self.path, {"about": self.about, "rows": rows})
        return rows[name]

    def _read(self) -> dict[str, Cells]:
        if self.path is None or not self.path.exists():
            return {}
        content = json.loads(self.path.read_text(encoding="utf-8"))
        if content["about"] != self.about:
            return {}
        return {name: tuple(cells) for name, cells in content["rows"].items()}
