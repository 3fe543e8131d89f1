"""Rows of a long benchmark that outlive its process."""

import pytest

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


def test_without_a_file_nothing_is_kept():
    rows = KeptRows(None, "two designs")
    rows.row("pi", lambda: ("pi", "47"))
    with pytest.raises(RuntimeError, match="measured again"):
        rows.row("pi", killed)
