"""Study files: what the user asks for, validated, and turned into traces and a model."""

import difflib
import glob
import hashlib
import importlib.metadata
import pathlib
import re
import tomllib
from typing import Any

import pydantic

from vgtjax import InputError
from vgtjax.traces import trace_suffixes

from ..output.files import REPORT, SUMMARY
from .base import override
from .places import StudyError
from .sentences import sentence
from .tables import AnyStudy, Study, TraceEntry

EXAMPLE = pathlib.Path(__file__).parents[1] / "example" / "study.toml"
"""The study that runs when none is named."""

FORMAT = 3
"""Of what is kept of computations that are not finished: one of another format begins again."""


class TraceSource(TraceEntry):
    """One trace file of a study after patterns are expanded."""

    path: pathlib.Path
    name: str


def load_study(path: pathlib.Path) -> Study:
    """Reads and validates a study file."""
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: the study can't be read ({error.strerror}); check its path") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path.name}: this is not valid TOML ({error}); repair the file") from error
    try:
        return AnyStudy.validate_python(raw)
    except pydantic.ValidationError as error:
        raise InputError(f"{path.name}: {sentence(error)}") from error


def expand_traces(study: Study, folder: pathlib.Path) -> list[TraceSource]:
    """The trace files of a study, patterns expanded in alphabetical order."""
    sources = []
    for entry in study.trace:
        for path in _files(folder, entry.file):
            name = _fill("{stem}" if entry.name is None else entry.name, path.stem)
            unit = None if entry.unit is None else _fill(entry.unit, path.stem)
            own = {"path": path, "name": name, "unit": unit, "channels": override(study.channels, entry.channels)}
            sources.append(TraceSource(**{**dict(entry), **own}))
    _check_names(sources)
    return sources


def _files(folder: pathlib.Path, pattern: str) -> list[pathlib.Path]:
    """The file of that name, or else all that match it as a pattern."""
    if (folder / pattern).is_file():
        return [folder / pattern]
    found = sorted(glob.glob(pattern, root_dir=folder, recursive=True))
    if not found:
        there = sorted(path.name for path in folder.glob("*") if path.suffix.lower() in trace_suffixes())
        near = difflib.get_close_matches(pattern, there, n=1, cutoff=0.0)
        remedy = f"did you mean '{near[0]}'?" if near else "names are relative to the study file"
        raise StudyError(f"trace file '{pattern}' matches nothing in {folder}; {remedy}")
    return [folder / file for file in found]


def _fill(pattern: str, stem: str) -> str:
    """`{stem}` is the file's stem and `{stem:7}` its first seven letters."""
    filled = re.sub(r"\{stem(?::(\d+))?\}", lambda m: stem[: int(m[1])] if m[1] else stem, pattern)
    if pattern.count("{") != len(re.findall(r"\{stem(?::\d+)?\}", pattern)):
        raise StudyError(f"only {{stem}} and e.g. {{stem:7}} may be in braces, but there is '{pattern}'; correct it")
    return filled


def _check_names(sources: list[TraceSource]) -> None:
    without = [source.name for source in sources if source.unit is None]
    if without and len(without) < len(sources):
        raise StudyError(
            f"either all traces have a unit or none has, but '{without[0]}' has none while others do; add unit to it"
        )
    named: dict[tuple[str | None, str], pathlib.Path] = {}
    for source in sources:
        for text, kind in ((source.name, "name"), (source.unit, "unit")):
            if text is not None and (not text or re.search(r"[/\\\0]", text) or text.startswith(".")):
                raise StudyError(f"the trace {kind} '{text}' can't be a file name; use letters and digits")
        if source.unit in (SUMMARY, REPORT):
            raise StudyError(f"the unit '{source.unit}' has the name of a file of results; give it another one")
        key = (source.unit, source.name)
        if key in named:
            apart = named[key].name != source.path.name or named[key] == source.path
            first, second = (path.name if apart else str(path) for path in (named[key], source.path))
            raise StudyError(
                f"the trace name '{source.name}' occurs twice ({first} and {second}); give one of them another name"
            )
        named[key] = source.path


def fingerprint(study: Study, sources: list[TraceSource], parameters: dict[str | None, dict[str, Any]]) -> str:
    """SHA-256 over all that a result depends on: version, study, names and bytes of its traces, given parameters."""
    digest = hashlib.sha256(f"{importlib.metadata.version('vgtjax')} {FORMAT}".encode())
    digest.update(repr(study.model_dump()).encode())  # JSON knows no infinity
    for source in sources:
        digest.update(repr((source.name, source.unit, source.use)).encode())
        digest.update(hash_file(source.path).encode())
    digest.update(repr(parameters).encode())
    return digest.hexdigest()


def hash_file(path: pathlib.Path) -> str:
    """SHA-256 of a trace file, which need not fit into memory."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
