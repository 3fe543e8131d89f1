"""Commands as a user runs them: in a process of their own."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest
from bad_traces import BAD_TRACES
from commands import cut_example, read

import vgtjax

COMMAND = [sys.executable, "-m", "calibrate"]


def run(*arguments: object, **options) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


@pytest.mark.parametrize("arguments", [["--help"], ["fit", "--help"], ["simulate", "-h"]])
def test_help_takes_less_than_a_second(arguments):
    seconds = []
    for _ in range(3):
        began = time.monotonic()
        outcome = run(*arguments)
        seconds.append(time.monotonic() - began)
        assert outcome.returncode == 0
        assert outcome.stdout.startswith("Usage: python -m calibrate")
    assert min(seconds) < 1.0  # the machine may be busy with something else


def test_help_needs_no_jax():
    code = "import sys, calibrate.__main__; print('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"


def test_bad_input_ends_with_status_2_and_one_line(folder):
    (folder / "bench.csv").write_bytes(BAD_TRACES["a gap"].raw)
    outcome = run("fit", folder / "study.toml", "--out", folder / "out")
    assert (outcome.returncode, outcome.stdout) == (2, "")
    assert outcome.stderr == f"error: bench.csv, {BAD_TRACES['a gap'].sentence}\n"
    assert not (folder / "out").exists()


def test_a_fit_needs_nothing_but_its_files(plain, tmp_path):
    outcome = run("fit", plain.name, "--out", "out", cwd=plain.parent)
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert read(plain.parent / "out" / "summary.json")["converged"] is True
    assert outcome.stdout.endswith(f"report: {(plain.parent / 'out' / 'report.html').resolve()}\n")


def test_an_interruption_while_loading_ends_with_status_130(folder):
    process = subprocess.Popen(
        [*COMMAND, "fit", "--out", str(folder / "out")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    time.sleep(1.0)  # in the middle of loading JAX, or of reading the traces
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert (process.returncode, stderr) == (130, "interrupted; the same command goes on from here\n")


@pytest.mark.skipif(os.name == "nt", reason="no such signal there")
def test_an_interruption_leaves_no_job_behind(tmp_path):
    """What the processes of several units are told of lies in a temporary folder."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    for number in (1, 2):
        cut_example("step_80", 0.3, tmp_path, f"unit_{number}")
    (tmp_path / "study.toml").write_text('[[trace]]\nfile = "unit_*.csv"\nunit = "{stem}"\n')
    process = subprocess.Popen(
        [*COMMAND, "identify", "study.toml", "--out", "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"TMPDIR": str(temporary)},
    )
    while process.poll() is None and not list(temporary.rglob("job")):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    # Python's tracker of resources may add what it has cleaned up.
    assert stderr.startswith("interrupted; the same command goes on from here\n")
    assert list(temporary.rglob("job")) == []


def test_without_a_study_the_example_that_ships_is_simulated(tmp_path):
    outcome = run("simulate", "--out", tmp_path / "out", cwd=tmp_path)
    assert (outcome.returncode, outcome.stderr) == (0, "")
    names = {path.stem for path in (tmp_path / "out").glob("*.csv")}
    example = pathlib.Path(vgtjax.__file__).parents[1] / "calibrate" / "example"
    assert names == {path.stem for path in example.glob("*.csv")}
    assert len(names) == 6


@pytest.mark.skipif(os.name == "nt", reason="no such script there")
def test_the_installed_script_is_the_same_command():
    script = pathlib.Path(sys.executable).parent / "vgtjax-calibrate"
    outcome = subprocess.run([script, "fit", "--help"], capture_output=True, text=True)
    assert outcome.returncode == 0
    assert "Calibrates the model to the traces of STUDY" in outcome.stdout
