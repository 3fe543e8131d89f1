"""MAT-files of MATLAB: versions 5 to 7 by scipy, 7.3 (HDF5) by h5py, tables and timetables in both by mat-io.

Whatever the version, a file is variables: a vector is a channel, and a struct or a table is a group of channels.
"""

import contextlib
import pathlib

from ._mat_variables import Load
from ._recording import Entry, Record, Recording, load_package, read_start, reading, require_start

HDF5 = b"\x89HDF"
VERSION_5 = (b"\x00\x01", b"\x01\x00")
"""Where a header has its version, in either order of bytes; 7.3 has a 2, and its text may say anything."""


class MATRecording(Recording):
    """Variables of a MAT-file; those of structs by the dotted path to them, whatever is no vector left out."""

    def __init__(self, path: pathlib.Path):
        self.path = path
        require_start(path, (b"MATLAB ", HDF5), "MATLAB")
        start = read_start(path, 128)
        with contextlib.ExitStack() as stack, reading(path, "MATLAB"):
            if start[124:126] in VERSION_5:
                from ._mat_5 import list_variables  # scipy, which takes a while to import

                found = list_variables(path, has_objects=bool(start[116:124].strip(b" \0")))
            else:
                from ._mat_hdf import list_datasets

                h5py = load_package(path, "h5py", "mat")
                found = list_datasets(path, stack.enter_context(h5py.File(path, "r")))
            self._loads: dict[Entry, Load] = dict(found)
            self.entries = list(self._loads)
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Closes the file."""
        self._stack.close()

    def read(self, entry: Entry) -> Record:
        """The numbers of a vector, and the times of a row of a timetable."""
        with reading(self.path, "MATLAB"):
            return self._loads[entry]()
