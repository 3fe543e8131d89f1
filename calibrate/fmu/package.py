"""An FMU: description, binaries and source in one archive."""

import hashlib
import io
import pathlib
import uuid
import zipfile
from typing import Any

import numpy as np

from vgtjax.plants import AbstractModel
from vgtjax.traces import SIGNALS, STANDARD_ATMOSPHERE

from .compilers import SYSTEMS, compile_library, compilers
from .description import IDENTIFIER, SOURCE, describe
from .equations import START, Equations
from .primitives import literal
from .variables import Variable, list_variables

TEMPLATE = pathlib.Path(__file__).parents[1] / "templates" / "fmu.c"


def to_fmu(model: AbstractModel, name: str, version: str, date: str) -> bytes:
    """A model as an FMU of FMI 2.0 for model exchange and co-simulation, for every system with a compiler.

    **Raises:** `InputError` where there is no C compiler; `SimulationError` where one fails.
    """
    commands = compilers()
    equations = Equations(model)
    variables = list_variables(equations)
    text = source(equations, variables)
    guid = f"{{{uuid.UUID(bytes=hashlib.sha256(text.encode()).digest()[:16])}}}"
    text = f'#define GUID "{guid}"\n{text}'
    libraries = {system: compile_library(text, system, command) for system, command in commands.items()}
    files = {"modelDescription.xml": describe(variables, name, guid, version, date), f"sources/{SOURCE}": text.encode()}
    files |= {f"binaries/{system}/{IDENTIFIER}{SYSTEMS[system][1]}": each for system, each in libraries.items()}
    return _archive(files, date)


def source(equations: Equations, variables: list[Variable]) -> str:
    """All of the C but for the GUID, which is a digest of it."""
    parts = (equations.entries, START, equations.inputs, equations.signals, equations.states)
    sizes = [f"#define N_{letter} {len(part)}" for letter, part in zip("PSUYX", parts, strict=True)]
    nominals = (each.nominal for each in variables if each.nominal is not None)
    held = ", ".join(str(int(SIGNALS[name].held)) for name in equations.inputs)
    definitions = [
        *sizes,
        f"#define STANDARD_ATMOSPHERE {literal(STANDARD_ATMOSPHERE)}",
        f"static const int IS_HELD[] = {{{held}}};",
        f"static const double START[] = {{{_numbers(each.start or 0.0 for each in variables)}}};",
        f"static const double NOMINAL[] = {{{_numbers(nominals)}}};",
    ]
    return "\n".join([equations.to_c(), *definitions, "", TEMPLATE.read_text(encoding="utf-8")])


def _numbers(values: Any) -> str:
    return ", ".join(literal(np.float64(value)) for value in values)


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
