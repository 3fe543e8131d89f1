"""Which reader a file gets."""

import functools
import importlib
import importlib.metadata
import pathlib
import re
import warnings
from collections.abc import Callable

from ..._errors import InputError
from ._recording import Recording, read_start

READERS: dict[str, str | Callable[[pathlib.Path], Recording]] = {
    ".mf4": "_mdf.MDFRecording",
    ".mdf": "_mdf.MDFRecording",
    ".dat": "_mdf.MDFRecording",
    ".tdms": "_tdms.TDMSRecording",
    ".mat": "_mat.MATRecording",
    ".parquet": "_parquet.ParquetRecording",
}
"""Readers by suffix, ours imported only when one is needed; every other suffix is text."""
TEXT = "_text.TextRecording"
SUFFIXES = (".csv", *READERS)
"""What trace files are called that this package reads."""
GROUP = "vgtjax.readers"
"""Entry points by which installed packages offer readers; the name of one is the suffix without its dot."""


def register_reader(suffix: str, reader: Callable[[pathlib.Path], Recording]) -> None:
    """Has files of another kind read by `load_trace`, in this process.

    A package that is installed does the same for every process, and so for studies and the command line, by an entry
    point of the group `vgtjax.readers` whose name is the suffix without its dot.

    **Arguments:** `suffix`: with its dot, in either case; `reader`: a [`Recording`][], or what opens one at a path.

    **Raises:** `InputError` for what is no suffix, or one that has a reader in this package.
    """
    suffix = suffix.lower()
    if not re.fullmatch(r"\.\w+", suffix):
        raise InputError(f"a reader is for a suffix like '.npz', but '{suffix}' is none; correct it", "suffix")
    if suffix in SUFFIXES:
        raise InputError(f"files with '{suffix}' have a reader already; give yours another suffix", "suffix")
    READERS[suffix] = reader


def trace_suffixes() -> tuple[str, ...]:
    """What trace files are called, with those of readers that others have registered."""
    _installed()
    return (".csv", *READERS)


def open_recording(path: pathlib.Path) -> Recording:
    """Opens a trace file with the reader for its suffix.

    **Raises:** `InputError` when the file is not what its suffix says, or its package is not installed.
    """
    _installed()
    suffix = path.suffix.lower()
    reader = READERS.get(suffix, TEXT)
    # Half of all programs call their files .dat; INCA and CANape mean MDF 3 by it.
    if suffix == ".dat" and not read_start(path, 8).startswith((b"MDF", b"UnFinMF")):
        reader = TEXT
    if not isinstance(reader, str):
        return reader(path)
    module, name = reader.split(".")
    return getattr(importlib.import_module(f".{module}", __package__), name)(path)


@functools.cache
def _installed() -> None:
    """Registers what installed packages offer, once a process; what a script has registered stays."""
    for point in importlib.metadata.entry_points(group=GROUP):
        if f".{point.name}".lower() not in READERS:
            try:
                register_reader(f".{point.name}", functools.partial(_load, point))
            except InputError as error:  # by one package that offers nonsense all others still read
                warnings.warn(f"the reader {point.value} is left out: {error}", stacklevel=2)


def _load(point: importlib.metadata.EntryPoint, path: pathlib.Path) -> Recording:
    """Opens a file with what an installed package offers.

    **Raises:** `InputError` when that can't be imported.
    """
    try:
        reader = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"{path.name}: its reader {point.value} can't be imported ({error}); reinstall the package that offers it"
        ) from error
    return reader(path)
