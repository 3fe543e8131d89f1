"""DCM: the calibration data of version 2.0 of the `KONSERVIERUNG_FORMAT`, lines of German keywords."""

import pathlib
import re
from collections.abc import Iterator

import numpy as np

from vgtjax import InputError

from .base import TOOL, Characteristic, DataSet, Found, identifier, number

FUNCTION = "actuator"
KEYWORDS = {
    "VALUE": "FESTWERT",
    "VAL_BLK": "FESTWERTEBLOCK",
    "COM_AXIS": "STUETZSTELLENVERTEILUNG",
    "CURVE": "GRUPPENKENNLINIE",
    "MAP": "GRUPPENKENNFELD",
}
READ = (*KEYWORDS.values(), "KENNFELD", "FESTKENNFELD")
"""Kinds of blocks that hold what a parameter is."""
COMMENTS = ("*", "!", ".")


def to_dcm(data: DataSet) -> bytes:
    """A data set as the text of a DCM file."""
    lines = [
        '* encoding="UTF-8"',
        f"* {TOOL} {data.version}, {data.date}",
        *(f"* SHA-256 of {trace}: {digest}" for trace, digest in data.hashes.items()),
        "",
        "KONSERVIERUNG_FORMAT 2.0",
        "",
        "FUNKTIONEN",
        f'   FKT {FUNCTION} "{data.version}" "{data.model_text}"',
        "END",
    ]
    for each in data.characteristics:
        lines += ["", *_block(each, data)]
    return "\n".join([*lines, ""]).encode()


def _block(each: Characteristic, data: DataSet) -> Iterator[str]:
    sizes = " ".join(str(size) for size in reversed(each.values.shape))  # columns, rows
    yield f"{KEYWORDS[each.category]} {identifier(each.name)} {sizes}".rstrip()
    yield f'   LANGNAME "{each.long_name}"'
    yield f"   FUNKTION {FUNCTION}"
    yield from (f"   {line}" for line in _values(each, data))
    history = (f"state: {each.state}", f"{TOOL} {data.version}, {data.date}", *each.remarks)
    yield from (f"* {text}" for text in history)
    yield "END"


def _values(each: Characteristic, data: DataSet) -> Iterator[str]:
    if each.category == "COM_AXIS":
        yield f'EINHEIT_X "{each.unit}"'
        yield f"ST/X {_numbers(each.values)}"
        return
    if not each.axes:
        yield f'EINHEIT_W "{each.unit}"'
        yield f"WERT {_numbers(each.values)}"
        return
    axes = {letter: data.named(axis) for letter, axis in zip("XY", reversed(each.axes), strict=False)}
    yield from (f'EINHEIT_{letter} "{axis.unit}"' for letter, axis in axes.items())
    yield f'EINHEIT_W "{each.unit}"'
    yield from (f"*SST{letter} {identifier(axis.name)}" for letter, axis in axes.items())
    yield f"ST/X {_numbers(axes['X'].values)}"
    if each.category == "CURVE":
        yield f"WERT {_numbers(each.values)}"
        return
    for knot, row in zip(axes["Y"].values, each.values, strict=True):
        yield f"ST/Y {number(knot)}"
        yield f"WERT {_numbers(row)}"


def _numbers(values: np.ndarray) -> str:
    return " ".join(number(value) for value in np.ravel(values))


def read_dcm(path: pathlib.Path) -> tuple[str, list[Found]]:
    """The line of a DCM file that names the model, and what it holds."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = [(place, line.strip()) for place, line in enumerate(text.splitlines(), 1)]
    lines = [(place, line) for place, line in lines if line and not line.startswith(COMMENTS)]
    if not lines or not lines[0][1].startswith("KONSERVIERUNG_FORMAT"):
        raise InputError(
            f"{path.name}: a DCM file begins with KONSERVIERUNG_FORMAT, but this does not; give a DCM file"
        )
    found: list[Found] = []
    block: list[str] = []
    model = head = ""
    for place, line in lines[1:]:
        keyword = line.split()[0]
        if not head and keyword in READ:
            head, block = line, []
        elif head and keyword == "END":
            found.append(_found(path, head, block))
            head = ""
        elif head:
            block.append(line)
        elif keyword == "FKT":
            model = model or _last_text(line)
        elif keyword in ("KENNLINIE", "FESTKENNLINIE", "TEXTSTRING"):
            raise InputError(f"{path.name}, line {place}: no parameter is a {keyword}; remove '{line}'")
    if head:
        raise InputError(f"{path.name}: '{head}' has no END; add it")
    return model, found


def _found(path: pathlib.Path, head: str, block: list[str]) -> Found:
    keyword, *named = head.split()
    if not named:
        raise InputError(f"{path.name}: a {keyword} has no name; add it")
    of_axis = keyword == KEYWORDS["COM_AXIS"]
    values, units = "ST/X" if of_axis else "WERT", "EINHEIT_X" if of_axis else "EINHEIT_W"
    numbers = [word for line in block if line.split()[0] == values for word in line.split()[1:]]
    unit = next((_last_text(line) for line in block if line.split()[0] == units), None)
    return Found(named[0], numbers, keyword == KEYWORDS["VALUE"], unit)


def _last_text(line: str) -> str:
    """The last of the texts in quotes."""
    texts = re.findall(r'"([^"]*)"', line)
    return texts[-1].strip() if texts else ""
