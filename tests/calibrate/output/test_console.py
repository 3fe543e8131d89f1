"""What a terminal shows."""

import rich.table

from calibrate.output.console import WIDE, say


def test_no_digit_of_a_table_is_cut_off_in_a_narrow_terminal(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    table = rich.table.Table("parameter", "value")
    table.add_row("p" * 70, "0.0123456")
    say(table)
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "0.0123456" in line]
    assert "p" * 70 in row
    assert len(row) <= WIDE


def test_a_sentence_is_one_line(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    say("word " * 40)
    assert capsys.readouterr().out.count("\n") == 1
