"""C that was emitted, compiled and called."""

import ctypes
import pathlib
from collections.abc import Callable

import numpy as np
import pytest

from calibrate.fmu.compilers import compile_library, compilers, own_system

POINTER = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
Library = Callable[..., np.ndarray]


@pytest.fixture(scope="session")
def load(tmp_path_factory) -> Callable[[str], Callable[..., np.ndarray]]:
    """Compiles C, and gives a function that calls a function in it: `call(name, size of the result, *arguments)`."""
    folder, count = tmp_path_factory.mktemp("libraries"), iter(range(10**6))
    system = own_system()
    assert system is not None

    def load(source: str) -> Callable[..., np.ndarray]:
        path = pathlib.Path(folder, f"{next(count)}.so")
        flags = ('-DVG_LOCAL=__attribute__((visibility("default")))', "-Wall", "-Wextra", "-Werror")
        path.write_bytes(compile_library(source, system, compilers()[system], *flags))
        library = ctypes.CDLL(str(path))

        def call(name: str, size: int, *arguments) -> np.ndarray:
            out = np.full(size, np.nan)
            given = [np.ascontiguousarray(each, float) if np.ndim(each) else float(each) for each in arguments]
            function = getattr(library, name)
            function.argtypes = [POINTER if np.ndim(each) else ctypes.c_double for each in given] + [POINTER]
            function.restype = None
            function(*given, out)
            return out

        return call

    return load
