"""A second run: does nothing, goes on where an earlier one was ended, or refuses another study's folder."""

import os
import pathlib
import signal
import subprocess
import sys

import pytest
from commands import read, run_command

from calibrate.output.files import MARKER, PROGRESS, write_json


def contents(folder: pathlib.Path) -> dict[str, tuple[int, bytes]]:
    """Every file below a folder with its time of writing."""
    return {
        str(path.relative_to(folder)): (path.stat().st_mtime_ns, path.read_bytes())
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_second_run_does_nothing(fitted):
    before = contents(fitted.out)
    outcome = run_command("fit", fitted.study, "--out", fitted.out)
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out.startswith(f"nothing to do: {fitted.out} holds the results already\n")
    assert contents(fitted.out) == before


@pytest.mark.parametrize("change", ["study", "trace", "parameters", "command"])
def test_another_study_is_refused_in_the_same_folder(fitted, small, change):
    arguments, command = [], "fit"
    if change == "study":
        small.write_text(small.read_text().replace("11500", "11501"))
    elif change == "trace":
        (small.parent / "step_50.csv").write_bytes((small.parent / "step_80.csv").read_bytes())
    elif change == "parameters":
        arguments = ["--parameters", fitted.out / "parameters.json"]
    else:
        command = "simulate"
    before = contents(fitted.out)
    outcome = run_command(command, small, "--out", fitted.out, *arguments)
    assert outcome.status == 2
    assert outcome.err == (
        f"error: {fitted.out} holds the results of another study ('fit', other inputs); choose another --out, or "
        "remove that folder\n"
    )
    assert contents(fitted.out) == before


def test_the_same_study_elsewhere_is_the_same_study(fitted, small):
    assert run_command("fit", small, "--out", fitted.out).status == 0


def end_after_two_steps(send):
    """`write_json`, that ends its process when the second step of a fit has been written."""

    def write(path, content):
        write_json(path, content)
        if path.name == PROGRESS and content["progress"]["iteration"] == 2:
            send()

    return write


# The command line in a process of its own, with the settings of the tests: other numbers of devices round differently.
ENDED = """
import os, signal, sys
import platformdirs, vgtjax
vgtjax.simulation._stepping.UNROLL = 1  # as in the process of the tests, to the bit
vgtjax.configure(cpu_devices=2, cache=platformdirs.user_cache_path("vgtjax") / "tests")
import calibrate.resumable
from commands import run_command
from test_resume import end_after_two_steps
number, *arguments = sys.argv[1:]
calibrate.resumable.write_json = end_after_two_steps(lambda: os.kill(os.getpid(), int(number)))
run_command("fit", *arguments)
"""


@pytest.mark.parametrize(
    ("number", "status", "message"),
    [
        pytest.param(signal.SIGINT, 130, "interrupted; the same command goes on from here\n", id="interrupted"),
        pytest.param(signal.SIGKILL, -signal.SIGKILL, "", id="killed"),
    ],
)
def test_a_fit_that_was_ended_goes_on_to_exactly_the_same_end(fitted, small, number, status, message):
    out, here = small.parent / "out", pathlib.Path(__file__).parent
    ended = subprocess.run(
        [sys.executable, "-c", ENDED, str(int(number)), str(small), "--out", str(out)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(here.parents[1]), str(here)])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (ended.returncode, ended.stderr) == (status, message)
    assert {path.name for path in out.iterdir()} == {MARKER, PROGRESS}
    assert read(out / PROGRESS)["progress"]["iteration"] == 2

    outcome = run_command("fit", small, "--out", out)
    assert (outcome.status, outcome.err) == (0, "")
    assert "resuming after step 2\n" in outcome.out
    assert read(out / "parameters.json") == read(fitted.out / "parameters.json")
    resumed, whole = (read(folder / "summary.json") for folder in (out, fitted.out))
    assert {**resumed, "wall_seconds": 0} == {**whole, "wall_seconds": 0}
    assert not (out / PROGRESS).exists()


def test_a_crash_while_writing_leaves_the_old_file(tmp_path, monkeypatch):
    write_json(tmp_path / "a.json", {"is": "old"})

    def crash(source, target):
        raise OSError("no space left")

    monkeypatch.setattr(os, "replace", crash)
    with pytest.raises(OSError, match="no space left"):
        write_json(tmp_path / "a.json", {"is": "new"})
    assert read(tmp_path / "a.json") == {"is": "old"}
