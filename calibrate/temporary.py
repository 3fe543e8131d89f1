"""Folders for a while, which an interruption removes as well."""

import contextlib
import pathlib
import shutil
import tempfile
from collections.abc import Iterator

_IN_USE: set[pathlib.Path] = set()


@contextlib.contextmanager
def temporary_folder() -> Iterator[pathlib.Path]:
    """A new folder, removed in the end, also where [`remove_temporary`][] is the end."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        _IN_USE.add(folder)
        try:
            yield folder
        finally:
            _IN_USE.discard(folder)


def remove_temporary() -> None:
    """Removes what is in use, for a process that ends without leaving its blocks."""
    for folder in tuple(_IN_USE):
        shutil.rmtree(folder, ignore_errors=True)
