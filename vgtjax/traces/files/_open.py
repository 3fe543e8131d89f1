"""Which reader a file gets."""

import importlib
import pathlib

from ._recording import Recording, read_start

READERS = {
    ".mf4": "_mdf.MDFRecording",
    ".mdf": "_mdf.MDFRecording",
    ".dat": "_mdf.MDFRecording",
    ".tdms": "_tdms.TDMSRecording",
    ".mat": "_mat.MATRecording",
    ".parquet": "_parquet.ParquetRecording",
}
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
    # Half of all programs call their files .dat; INCA and CANape mean MDF 3 by it.
    if suffix == ".dat" and not read_start(path, 8).startswith((b"MDF", b"UnFinMF")):
        reader = TEXT
    module, name = reader.split(".")
    return getattr(importlib.import_module(f".{module}", __package__), name)(path)
