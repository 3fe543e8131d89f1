"""Rows of a long benchmark on disk, so that one that was interrupted goes on."""

import dataclasses
import functools
import hashlib
import json
import pathlib
from collections.abc import Callable

import vgtjax

from ..output.files import write_json

Cells = tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class KeptRows:
    """Rows by their names, in a JSON file; `path` may be `None`: then nothing is kept.

    The file holds for one `about`, the text that says what is measured, and for the sources that measured it; with
    another text, or after a change of the code, it begins anew.
    """

    path: pathlib.Path | None
    about: str

    def row(self, name: str, measure: Callable[[], Cells]) -> Cells:
        """The cells of a row, measured unless the file has them."""
        rows = self._read()
        if name not in rows:
            rows[name] = measure()
            if self.path is not None:
                write_json(self.path, {"about": self.about, "sources": name_sources(), "rows": rows})
        return rows[name]

    def _read(self) -> dict[str, Cells]:
        if self.path is None or not self.path.exists():
            return {}
        content = json.loads(self.path.read_text(encoding="utf-8"))
        if content["about"] != self.about or content.get("sources") != name_sources():
            return {}
        return {name: tuple(cells) for name, cells in content["rows"].items()}


@functools.cache
def name_sources() -> str:
    """A hash of all sources of the library and of the application, as they were when it was first asked for."""
    sources = hashlib.sha256()
    for root in (pathlib.Path(vgtjax.__file__).parent, pathlib.Path(__file__).parents[1]):
        for file in sorted(root.rglob("*.py")):
            sources.update(str(file.relative_to(root.parent)).encode() + b"\0" + file.read_bytes() + b"\0")
    return sources.hexdigest()
