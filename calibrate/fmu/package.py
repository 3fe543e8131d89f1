"""An FMU: description, binaries and source in one archive."""

import hashlib
import io
import uuid
import zipfile

from .compilers import SYSTEMS, compile_library, compilers
from .description import describe
from .unit import Unit


def to_fmu(unit: Unit, name: str, version: str, date: str) -> bytes:
    """A plant or a controller as an FMU of FMI 2.0, for every system with a compiler.

    **Raises:** `InputError` where there is no C compiler; `SimulationError` where one fails.
    """
    commands = compilers()
    guid = f"{{{uuid.UUID(bytes=hashlib.sha256(unit.code.encode()).digest()[:16])}}}"
    text = f'#define GUID "{guid}"\n{unit.code}'
    libraries = {system: compile_library(text, system, command) for system, command in commands.items()}
    description = describe(unit, name, guid, version, date)
    files = {"modelDescription.xml": description, f"sources/{unit.source}": text.encode()}
    files |= {f"binaries/{system}/{unit.identifier}{SYSTEMS[system][1]}": each for system, each in libraries.items()}
    return _archive(files, date)


def _archive(files: dict[str, bytes], date: str) -> bytes:
    """The same files are the same archive."""
    archive = io.BytesIO()
    year, month, day = map(int, date.split("-"))
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for path, content in files.items():
            entry = zipfile.ZipInfo(path, (max(year, 1980), month, day, 0, 0, 0))  # what an archive can say
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            packed.writestr(entry, content)
    return archive.getvalue()
