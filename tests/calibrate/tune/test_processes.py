"""Tuning in several processes, each a process of its own as a user starts it."""

import pathlib
import socket
import subprocess
import sys

import numpy as np
import pytest
from commands import read

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
    return subprocess.Popen([*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen) -> str:
    out, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> pathlib.Path:
    folder = tmp_path_factory.mktemp("processes")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    return folder


def test_two_processes_find_the_gains_of_one(folder):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        where = f"localhost:{free.getsockname()[1]}"
    options = ("--coordinator", where, "--processes", "2", "--process")
    both = [start(folder, "two", *options, index) for index in "01"]
    finish(start(folder, "one"))
    first, second = map(finish, both)
    # The first one talks and writes.
    assert "report:" in first
    assert "report:" not in second  # nor the table of steps; the network says something of its own
    assert "seconds" not in second
    mine, yours = (read(folder / out / "summary.json") for out in ("two", "one"))
    assert mine["iterations"] == yours["iterations"] > 0
    # The same programs for other numbers of lanes: rounding, which a PI that is calm hardly amplifies.
    np.testing.assert_allclose(mine["history"], yours["history"], rtol=1e-6)
    gains = [read(folder / out / "gains.json")["parameters"] for out in ("two", "one")]
    for name, row in gains[1].items():
        assert gains[0][name]["value"] == pytest.approx(row["value"], rel=1e-6)
