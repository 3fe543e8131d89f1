"""The same calls under other settings of JAX, in a process of their own: JAX reads its settings once.

Run as `python -m calibrate.bench.served forward 2`, it says how many devices it sees, compiles, and then runs once a
line of its input and says what processors spent on that; without a number of devices it has JAX's own settings.
"""

import contextlib
import os
import subprocess
import sys
import time
from types import TracebackType

import jax

from .workloads import WORKLOADS


class Served:
    """A process that runs one workload when called, on so many devices with this package's settings, or with JAX in
    double precision and nothing else set. `devices` is how many it sees."""

    def __init__(self, workload: str, devices: int | None = None):
        command = [sys.executable, "-m", f"{__package__}.served", workload]
        command += [] if devices is None else [str(devices)]
        # Not the flags that configure() has put into this process's environment.
        environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self.devices = int(self._answer())

    def __enter__(self) -> "Served":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate()  # closes its input, which is its sign to end

    def __call__(self) -> float:
        """Runs the workload once; waking the other process takes some 50 us.

        **Returns:** s of all processors that the run took.

        **Raises:** `RuntimeError` when the process has died.
        """
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # of a process that has died, which has no answer either
            self._process.stdin.write("\n")
            self._process.stdin.flush()
        return float(self._answer())

    def _answer(self) -> str:
        assert self._process.stdout is not None
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError("the process with other settings of JAX died; its error is above")
        return answer


def _serve(workload: str, devices: int | None) -> None:
    if devices is None:
        jax.config.update("jax_enable_x64", True)
    else:
        from vgtjax import configure

        configure(cpu_devices=devices)
    print(jax.device_count(), flush=True)
    run = WORKLOADS[workload]()
    for _ in sys.stdin:
        began = time.process_time()
        jax.block_until_ready(run())
        print(time.process_time() - began, flush=True)


if __name__ == "__main__":
    _serve(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None)
