"""Commands in processes of their own, as a user runs them."""

import dataclasses
import json
import os
import pathlib
import subprocess
import sys
import time
from collections.abc import Sequence

WHOLE = "in all"
"""What a watched command took, as a user waits for it."""


def run_command(arguments: list[str], cache: pathlib.Path) -> float:
    """`python -m calibrate ARGUMENTS` with its compiled programs in a folder; s.

    **Raises:** `RuntimeError` for a status other than 0.
    """
    return _run("calibrate", arguments, cache)


def watch_command(arguments: list[str], cache: pathlib.Path, times: pathlib.Path) -> dict[str, float]:
    """The same watched from inside: the s that it spent at each thing, and in all, by way of a file of these."""
    whole = _run("calibrate.bench.watched", [str(times), *arguments], cache)
    return {**json.loads(times.read_text(encoding="utf-8")), WHOLE: whole}


@dataclasses.dataclass(frozen=True)
class Spent:
    """What commands took together: s on the clock, and s of all processors."""

    wall: float
    cpu: float


def run_together(commands: Sequence[list[str]], cache: pathlib.Path, devices: int) -> Spent:
    """Commands of `python -m calibrate` at once, each in a process of its own with so many devices.

    **Raises:** `RuntimeError` for a status other than 0.
    """
    settings = {**environment(cache), "XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}"}
    began, before = time.perf_counter(), os.times()
    running = [_start("calibrate", arguments, settings) for arguments in commands]
    try:
        for process, arguments in zip(running, commands, strict=True):
            _finish(process, arguments)
    finally:
        for process in running:
            process.kill()  # one that waits for another which has died; does nothing to those that have ended
            process.wait()
    wall, after = time.perf_counter() - began, os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Spent(wall, cpu)


def _run(module: str, arguments: list[str], cache: pathlib.Path) -> float:
    began = time.perf_counter()
    _finish(_start(module, arguments, environment(cache)), [module, *arguments])
    return time.perf_counter() - began


def environment(cache: pathlib.Path) -> dict[str, str]:
    """Variables of a command whose compiled programs are in a folder; it sets JAX's flags itself, and not to those that
    `configure()` has put into the environment of this process."""
    own = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    return {**own, "XDG_CACHE_HOME": str(cache / "cache")}


def _start(module: str, arguments: list[str], settings: dict[str, str]) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", module, *arguments]
    return subprocess.Popen(command, env=settings, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def _finish(process: subprocess.Popen[str], arguments: list[str]) -> None:
    said = process.communicate()[1]
    if process.returncode != 0:
        raise RuntimeError(f"{' '.join(arguments)} ended with status {process.returncode}: {said.strip()}")
