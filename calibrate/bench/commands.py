"""Commands in processes of their own, as a user runs them."""

import os
import pathlib
import subprocess
import sys
import time


def run_command(arguments: list[str], cache: pathlib.Path) -> float:
    """`python -m calibrate ARGUMENTS` with its compiled programs in a folder; s.

    **Raises:** `RuntimeError` for a status other than 0.
    """
    # Not the flags that configure() has put into this process's environment; the command sets its own.
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    environment["XDG_CACHE_HOME"] = str(cache / "cache")
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "calibrate", *arguments], env=environment, capture_output=True, text=True
    )
    if done.returncode != 0:
        raise RuntimeError(f"calibrate {arguments[0]} ended with status {done.returncode}: {done.stderr.strip()}")
    return time.perf_counter() - began
