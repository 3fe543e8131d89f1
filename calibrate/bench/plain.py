"""The same calls under JAX's own settings, in a process of their own: JAX reads its settings once.

Run as `python -m calibrate.bench.plain forward`, it compiles, says so, and then runs once a line of its input.
"""

import os
import subprocess
import sys
from types import TracebackType

import jax

from .workloads import WORKLOADS


class PlainJax:
    """A process with JAX in double precision and nothing else set, which runs one workload when called."""

    def __init__(self, workload: str):
        command = [sys.executable, "-m", f"{__package__}.plain", workload]
        # Not the flags that configure() has put into this process's environment.
        environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def __enter__(self) -> "PlainJax":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def __call__(self) -> None:
        """Runs the workload once; waking the other process takes some 50 us."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        if not self._process.stdout.readline():
            raise RuntimeError("the process with plain JAX settings died; its error is above")


def _serve(workload: str) -> None:
    jax.config.update("jax_enable_x64", True)
    run = WORKLOADS[workload]()
    for _ in sys.stdin:
        jax.block_until_ready(run())
        print("done", flush=True)


if __name__ == "__main__":
    _serve(sys.argv[1])
