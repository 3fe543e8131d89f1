"""Tuning in several processes, each a process of its own as a user starts it."""

import os
import pathlib
import re
import signal
import socket
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest
from commands import read

from calibrate.output.files import PROGRESS

STUDY = """
name = "a quick PI, shared"
[control]
design = "pi"
duration = 0.2
settled = 0.1
period = 2e-3
turbine_pressure = [0]
[[control.reference]]
kind = "sine"
amplitude = 0.001
rate = 24.0
offset = 0.005
[[control.reference]]
kind = "sine"
name = "slower"
amplitude = 0.002
rate = 12.0
offset = 0.004
"""


def start(folder: pathlib.Path, out: str, *options: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "calibrate", "tune", str(folder / "study.toml"), "--out", str(folder / out)]
    # As in tests/conftest.py: these programs run for milliseconds and compile for seconds.
    environment = os.environ | {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([*command, *options], env=environment, text=True, **pipes)


def finish(process: subprocess.Popen) -> str:
    out, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("processes")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def alone(folder) -> dict:
    """What one process finds."""
    finish(start(folder, "one"))
    return read(folder / "one" / "summary.json")


def start_both(folder: pathlib.Path, out: str) -> list[subprocess.Popen]:
    with socket.socket() as free:
        free.bind(("localhost", 0))
        where = f"localhost:{free.getsockname()[1]}"
    return [start(folder, out, "--coordinator", where, "--processes", "2", "--process", index) for index in "01"]


def kill_one(folder: pathlib.Path, victim: int, after: int) -> tuple[int, str]:
    """Kills one of two processes once so many steps are saved; the status of the other one, and its errors."""
    both, deadline = start_both(folder, "killed"), time.monotonic() + 240
    progress = folder / "killed" / PROGRESS
    while not progress.exists() or len(read(progress)["progress"]["kinds"]) < after:
        assert time.monotonic() < deadline, "no step came"
        assert both[0].poll() is None, "it ended before one could be killed"
        time.sleep(0.01)
    both[victim].send_signal(signal.SIGKILL)
    try:  # A step, half a second, goes before the next exchange; JAX's own watch over its processes takes 100 s.
        _, errors = both[1 - victim].communicate(timeout=20)
    finally:
        both[1 - victim].kill()
        both[1 - victim].communicate()
        both[victim].communicate()
    return both[1 - victim].returncode, errors


@pytest.fixture(scope="module")
def survived(folder) -> dict[str, Any]:
    """A run of two processes, of which the second one is killed, then the one that leads, and which ends at last."""
    second = kill_one(folder, victim=1, after=1)
    first = kill_one(folder, victim=0, after=3)
    talk = tuple(map(finish, start_both(folder, "killed")))
    return {"second killed": second, "first killed": first, "talk": talk, "out": folder / "killed"}


def test_a_process_that_dies_is_noticed_in_seconds(survived):
    """Killed without a word."""
    status, errors = survived["second killed"]
    assert status == 1
    assert errors == "failed: another process of this run has died; start all of them again, and they go on\n"
    # JAX may end a process that has lost its first one before it can say anything itself.
    status, _ = survived["first killed"]
    assert status != 0


def test_a_run_goes_on_once_all_are_started_again(survived):
    resumed = re.search(r"resuming after step (\d+)", survived["talk"][0])
    assert resumed
    assert int(resumed[1]) >= 3


def test_two_processes_find_the_gains_of_one(survived, folder, alone):
    """Through every step, as two processes made all of them."""
    first, second = survived["talk"]
    # The first one talks and writes.
    assert "report:" in first
    assert "report:" not in second  # nor the table of steps; the network says something of its own
    assert "seconds" not in second
    mine = read(survived["out"] / "summary.json")
    assert mine["iterations"] == alone["iterations"] > 0
    # The same programs for other numbers of lanes: rounding, which a PI that is calm hardly amplifies.
    np.testing.assert_allclose(mine["history"], alone["history"], rtol=1e-6)
    gains = [read(out / "gains.json")["parameters"] for out in (survived["out"], folder / "one")]
    for name, row in gains[1].items():
        assert gains[0][name]["value"] == pytest.approx(row["value"], rel=1e-6)


OWN_TROUBLE = """
import jax
from calibrate.processes import bereaved
jax.process_count = lambda: 2
with bereaved():
    raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: out of memory")
print("it went on")
"""


def test_trouble_of_ones_own_is_no_other_processs_death_but_ends_it_as_well():
    """In a process of its own, which it ends: one that waited for the others would leave them waiting for it."""
    ended = subprocess.run([sys.executable, "-c", OWN_TROUBLE], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1].endswith("RESOURCE_EXHAUSTED: out of memory")
    assert "has died" not in ended.stderr
    assert not ended.stdout
