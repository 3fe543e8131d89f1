"""The rooms as CONTRIBUTING has them: which there are, and that imports go up its table and through a room's door."""

import ast
import pathlib
from collections.abc import Iterator

import pytest

from calibrate.manual.contributing import ROOT, table

ROOMS = [row[0].strip("`") for row in table("room")]
FILES = sorted(path.relative_to(ROOT) for top in ("vgtjax", "calibrate") for path in (ROOT / top).rglob("*.py"))


def imported(file: pathlib.Path) -> Iterator[tuple[str, ...]]:
    """Paths of all that a file imports, wherever it does so: of the modules, and of what it takes out of them."""
    folder = file.parent.parts
    for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (tuple(each.name.split(".")) for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = folder[: len(folder) + 1 - node.level] if node.level else ()
            module = (*above, *(node.module.split(".") if node.module else ()))
            yield from ((*module, each.name) for each in node.names)


def stranger(file: pathlib.Path, path: tuple[str, ...]) -> bool:
    """Whether a path leads to a private module, of ours, of a folder in which a file is not."""
    folders = [path[:place] for place, name in enumerate(path) if name.startswith("_") and not name.startswith("__")]
    return path[0] in ("vgtjax", "calibrate") and any(file.parts[: len(each)] != each for each in folders)


def test_the_table_has_every_room():
    assert {path.name for path in (ROOT / "vgtjax").iterdir() if (path / "__init__.py").exists()} == set(ROOMS)
    assert len(ROOMS) == len(set(ROOMS))


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_from_rooms_above_it_only(room):
    files = [file for file in FILES if file.parts[:2] == ("vgtjax", room)]
    assert files
    below = set(ROOMS[ROOMS.index(room) + 1 :])
    wrong = [(str(file), path) for file in files for path in imported(file) if path[0] == "vgtjax" and path[1] in below]
    assert wrong == []


def test_the_library_never_imports_the_application():
    assert [
        str(file) for file in FILES if file.parts[0] == "vgtjax" and any(p[0] == "calibrate" for p in imported(file))
    ] == []


@pytest.mark.parametrize("top", ["vgtjax", "calibrate"])
def test_what_is_private_is_imported_from_inside_only(top):
    files = [file for file in FILES if file.parts[0] == top]
    assert [(str(file), path) for file in files for path in imported(file) if stranger(file, path)] == []
