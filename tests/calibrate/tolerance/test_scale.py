"""The same study on other devices and in several processes, each a process of its own as a user starts it."""

import os
import pathlib
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from population_study import STUDY, write_study

from calibrate.population.chunks import FOLDER


def start(folder: pathlib.Path, out: str, *options: str, devices: int = 1) -> subprocess.Popen:
    """`python -m calibrate tolerance` with so many devices."""
    environment = {**os.environ, "XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}"}
    command = [sys.executable, "-m", "calibrate", "tolerance", str(folder / "study.toml"), "--out", str(folder / out)]
    return subprocess.Popen(
        [*command, *options], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def finish(*processes: subprocess.Popen) -> None:
    errors = [process.communicate(timeout=300)[1] for process in processes]
    assert not any(process.returncode for process in processes), "\n".join(errors)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> pathlib.Path:
    """A study's folder with the results of one device in `one`."""
    folder = tmp_path_factory.mktemp("scale")
    write_study(folder)
    finish(start(folder, "one"))
    return folder


def assert_same(folder: pathlib.Path, out: str) -> None:
    mine, yours = np.load(folder / out / "samples.npz"), np.load(folder / "one" / "samples.npz")
    np.testing.assert_array_equal(mine["values"], yours["values"])
    size = np.abs(yours["outputs"]).max(axis=0)
    np.testing.assert_allclose(mine["outputs"] / size, yours["outputs"] / size, rtol=0, atol=1e-9)  # what was promised
    assert (folder / out / "report.html").exists()


def test_eight_devices_give_the_same_numbers(folder):
    finish(start(folder, "eight", devices=8))
    assert_same(folder, "eight")


def test_two_processes_give_the_same_numbers(folder):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        where = f"localhost:{free.getsockname()[1]}"
    finish(
        *(start(folder, "two", "--coordinator", where, "--processes", "2", "--process", str(index)) for index in (0, 1))
    )
    assert_same(folder, "two")
    assert {path.name for path in (folder / "two").iterdir()} == {
        ".study.json",
        "summary.json",
        "samples.npz",
        "report.html",
    }


def test_killed_study_resumes(folder):
    """Killed without a word after its first chunk; the same command goes on from there."""
    (folder / "study.toml").write_text(STUDY.replace("lanes = 8", "lanes = 1"))
    process = start(folder, "killed")
    chunks, deadline = folder / "killed" / FOLDER, time.monotonic() + 120
    while not list(chunks.glob("*.npy")):
        assert time.monotonic() < deadline, "no chunk came"
        assert process.poll() is None, "it ended before it could be killed"
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    done = len(list(chunks.glob("*.npy")))
    assert not (folder / "killed" / "report.html").exists()
    again = start(folder, "killed")
    out, errors = again.communicate(timeout=300)
    assert again.returncode == 0, errors
    assert f"resuming with {done} of 24 chunks done" in out
    assert_same(folder, "killed")
