"""Files and folders of results, whatever happens while they are written."""

import errno
import os

import pytest

import vgtjax
from calibrate.output.files import MARKER, claim, release, write_text


def test_what_cant_be_written_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    write_text(tmp_path / "report.html", "old")

    def full(new, old):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_text(tmp_path / "report.html", "new")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("report.html", "old")]


def test_a_folder_that_nobody_has_finished_claiming_is_free(tmp_path):
    """By a process that was killed between its first file and that file's name."""
    (tmp_path / f".{MARKER}.new").write_text("half of it")
    claim(tmp_path, "fit", "one")
    assert [path.name for path in tmp_path.iterdir()] == [MARKER]
    claim(tmp_path, "fit", "one")
    with pytest.raises(vgtjax.InputError, match="holds the results of another study"):
        claim(tmp_path, "fit", "another")
    release(tmp_path)
    (tmp_path / "notes.txt").write_text("of a user")
    with pytest.raises(vgtjax.InputError, match="is not empty and no study wrote it"):
        claim(tmp_path, "fit", "one")
