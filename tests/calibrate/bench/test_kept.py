"""Rows of a long benchmark that outlive its process."""

import json

import pytest

from calibrate.bench import kept
from calibrate.bench.kept import KeptRows


def killed() -> tuple[str, ...]:
    raise RuntimeError("measured again")


def test_a_row_is_measured_once(tmp_path):
    path = tmp_path / "rows.json"
    first = KeptRows(path, "two designs")
    assert first.row("pi", lambda: ("pi", "47")) == ("pi", "47")
    with pytest.raises(RuntimeError, match="measured again"):
        first.row("lqg", killed)
    later = KeptRows(path, "two designs")
    assert later.row("pi", killed) == ("pi", "47")
    assert later.row("lqg", lambda: ("lqg", "7")) == ("lqg", "7")
    assert KeptRows(path, "two designs").row("lqg", killed) == ("lqg", "7")


def test_rows_of_another_measurement_do_not_count(tmp_path):
    path = tmp_path / "rows.json"
    KeptRows(path, "four plants").row("pi", lambda: ("pi", "47"))
    assert KeptRows(path, "eight plants").row("pi", lambda: ("pi", "50")) == ("pi", "50")


def test_rows_of_other_sources_do_not_count(tmp_path, monkeypatch):
    path = tmp_path / "rows.json"
    KeptRows(path, "four plants").row("pi", lambda: ("pi", "47"))
    monkeypatch.setattr(kept, "name_sources", lambda: "changed since")
    assert KeptRows(path, "four plants").row("pi", lambda: ("pi", "50")) == ("pi", "50")
    content = json.loads(path.read_text())
    assert content["sources"] == "changed since"
    # As files of earlier versions were: nothing says what measured them.
    path.write_text(json.dumps({name: content[name] for name in ("about", "rows")}))
    assert KeptRows(path, "four plants").row("pi", lambda: ("pi", "51")) == ("pi", "51")


def test_the_name_of_sources_changes_with_one_of_them(tmp_path, monkeypatch):
    for package in ("vgtjax", "calibrate/bench"):
        (tmp_path / package).mkdir(parents=True)
    monkeypatch.setattr(kept.vgtjax, "__file__", str(tmp_path / "vgtjax" / "__init__.py"))
    monkeypatch.setattr(kept, "__file__", str(tmp_path / "calibrate" / "bench" / "kept.py"))
    names = []
    for text in ("a = 1", "a = 2", "a = 1"):
        (tmp_path / "vgtjax" / "law.py").write_text(text)
        names.append(kept.name_sources.__wrapped__())
    (tmp_path / "calibrate" / "tune.py").write_text("")
    assert names[0] == names[2] != names[1]
    assert kept.name_sources.__wrapped__() != names[2]


def test_without_a_file_nothing_is_kept():
    rows = KeptRows(None, "two designs")
    rows.row("pi", lambda: ("pi", "47"))
    with pytest.raises(RuntimeError, match="measured again"):
        rows.row("pi", killed)
