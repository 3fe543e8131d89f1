"""Files that a command writes: whole or not at all, and never over another study's results."""

import contextlib
import csv
import io
import json
import math
import os
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from vgtjax import InputError

MARKER = ".study.json"
PROGRESS = ".progress.json"
SUMMARY, REPORT = "summary.json", "report.html"


def finite(values: Any) -> Any:
    """The same for JSON, which has neither NaN nor infinity: `None` where a number is none, arrays as lists."""
    if isinstance(values, dict):
        return {key: finite(value) for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [finite(value) for value in values]
    if hasattr(values, "__array__"):
        return finite(np.asarray(values).tolist())
    return None if isinstance(values, float) and not math.isfinite(values) else values


@contextlib.contextmanager
def replacing(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """A new file that takes the place of `path` in the end, so that a crash leaves either the old or the new one."""
    new = path.with_name(f".{path.name}.new")
    try:
        yield new
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)


def write_text(path: pathlib.Path, text: str) -> None:
    """Writes a text file whole or not at all."""
    with replacing(path) as new:
        new.write_text(text, encoding="utf-8")


def columns_csv(columns: Mapping[str, Float[np.ndarray, " rows"]]) -> str:
    """Columns by their headers as the text of a CSV file; times to the last digit, as they may count from 1970."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    digits = [".17g" if header.startswith("time") else ".9g" for header in columns]
    shown = [
        [repr(float(value)) if form == ".17g" else f"{value:{form}}" for value in values]
        for form, values in zip(digits, columns.values(), strict=True)
    ]
    writer.writerows(zip(*shown, strict=True))
    return text.getvalue()


def write_json(path: pathlib.Path, content: Any) -> None:
    """Writes JSON, with null for what is not finite: a fit that got lost has such figures."""
    write_text(path, json.dumps(finite(content), indent=2, allow_nan=False) + "\n")


def read_json(path: pathlib.Path) -> Any:
    """Reads JSON that this package wrote, or an editor with a byte-order mark."""
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"), parse_int=_whole)
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror}); check the path") from error
    except ValueError as error:
        raise InputError(f"{path.name}: this is not valid JSON ({error}); write it again") from error


def _whole(digits: str) -> float:
    """A whole number; one beyond 64 bits as a float, infinite if need be."""
    number = float(digits)
    return int(digits) if abs(number) < 2**63 else number


def claim(out: pathlib.Path, command: str, fingerprint: str) -> None:
    """Makes `out` the folder of this command and study."""
    marker = out / MARKER
    if out.exists() and not out.is_dir():
        raise InputError(f"--out must be a folder, but {out} is a file; choose another name")
    if marker.exists():
        owner = read_json(marker)
        if owner != {"command": command, "fingerprint": fingerprint}:
            raise InputError(
                f"{out} holds the results of another study ('{owner.get('command')}', other inputs); choose another "
                "--out, or remove that folder"
            )
        return
    begun = marker.with_name(f".{MARKER}.new")  # by a process that was ended before it had claimed the folder
    if out.exists() and any(path != begun for path in out.iterdir()):
        raise InputError(f"{out} is not empty and no study wrote it; choose another --out")
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_json(marker, {"command": command, "fingerprint": fingerprint})
    except OSError as error:
        raise InputError(f"{out}: can't be written ({error.strerror}); choose another --out") from error


def release(out: pathlib.Path) -> None:
    """Gives a folder back in which nothing was written after it was claimed."""
    inside = [path for path in out.iterdir() if path != out / MARKER]
    if all(path.is_dir() and not any(path.iterdir()) for path in inside):
        for path in inside:
            path.rmdir()
        (out / MARKER).unlink(missing_ok=True)
