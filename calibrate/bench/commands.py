"""Commands in processes of their own, as a user runs them."""

import json
import os
import pathlib
import subprocess
import sys
import time

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


def _run(module: str, arguments: list[str], cache: pathlib.Path) -> float:
    # Not the flags that configure() has put into this process's environment; the command sets its own.
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    environment["XDG_CACHE_HOME"] = str(cache / "cache")
    began = time.perf_counter()
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command[2:])} ended with status {done.returncode}: {done.stderr.strip()}")
    return time.perf_counter() - began
