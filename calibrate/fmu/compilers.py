"""C compilers: the machine's own, and one that builds for other systems too."""

import os
import platform
import shutil
import subprocess
import sys
from importlib.util import find_spec

from vgtjax import InputError, SimulationError

from ..temporary import temporary_folder

SYSTEMS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so"),
    "win64": ("x86_64-windows-gnu", ".dll"),
    "darwin64": ("x86_64-macos", ".dylib"),
}
"""Folders of binaries in FMI 2.0, what Zig calls these systems, and the endings of their libraries."""
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s")
"""A product and a sum are not joined to one rounding, so that all systems find the same numbers."""


def own_system() -> str | None:
    """This machine's folder, if FMI 2.0 has one for it."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return None
    return {"linux": "linux64", "win32": "win64", "darwin": "darwin64"}.get(sys.platform)


def own_compiler() -> str | None:
    """The machine's own compiler: that of `CC`, or the first that is found."""
    named = os.environ.get("CC")
    return next((found for name in (named, "cc", "gcc", "clang") if name and (found := shutil.which(name))), None)


def compilers() -> dict[str, tuple[str, ...]]:
    """The command that compiles for each system for which one is there.

    **Raises:** `InputError` where there is none.
    """
    found: dict[str, tuple[str, ...]] = {}
    if find_spec("ziglang") is not None:
        zig = (sys.executable, "-m", "ziglang", "cc", "-target")
        found = {system: (*zig, target) for system, (target, _) in SYSTEMS.items()}
    own, system = own_compiler(), own_system()
    if own is not None and system is not None:
        found[system] = (own, "-fPIC") if system != "win64" else (own,)
    if not found:
        raise InputError(
            "an FMU needs a C compiler, but there is none; install gcc or clang, or run pip install '.[fmu]' in a "
            "clone of vgtjax"
        )
    return found


def compile_library(source: str, system: str, command: tuple[str, ...], *flags: str) -> bytes:
    """A shared library for a system.

    **Raises:** `SimulationError` with what the compiler said.
    """
    with temporary_folder() as folder:
        file, library = folder / "model.c", folder / f"model{SYSTEMS[system][1]}"
        file.write_text(source, encoding="utf-8")
        math = () if system == "win64" else ("-lm",)
        done = subprocess.run(
            [*command, *FLAGS, *flags, "-o", str(library), str(file), *math], capture_output=True, text=True, cwd=folder
        )
        if done.returncode != 0:
            said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip())
            raise SimulationError(f"{command[0]} could not compile the FMU for {system}: {said}")
        return library.read_bytes()
