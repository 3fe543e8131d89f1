"""Which reader a file gets."""

import importlib
import pathlib

from ._recording import Recording

READERS: dict[str, str] = {}
"""Readers by suffix, imported only when one is needed; every other suffix is text."""
TEXT = "_text.TextRecording"
SUFFIXES = (".csv", *READERS)
"""What trace files are called."""


def open_recording(path: pathlib.Path) -> Recording:
    """Opens a trace file with the reader for its suffix.

    **Raises:** `InputError` when the file is not what its suffix says, or its package is not installed.
    """
    suffix = path.suffix.lower()
    reader = READERS.get(suffix, TEXT)
    module, name = reader.split(".")
    return getattr(importlib.import_module(f".{module}", __package__), name)(path)
