"""What a user sees while a command works."""

import time
from collections.abc import Iterable
from types import TracebackType

import rich.console
import rich.status

from vgtjax import Trace
from vgtjax.estimation import Progress

console = rich.console.Console(highlight=False, markup=False, soft_wrap=True)


def say_notes(traces: Iterable[Trace]) -> None:
    """What loading the traces assumed or ignored."""
    for trace in traces:
        for note in trace.notes:
            console.print(f"note: {trace.name}: {note}")


class FitDisplay:
    """A line for every step of a fit, under a clock that shows what is being waited for."""

    def __init__(self, title: str):
        self._began = time.monotonic()
        self._status = rich.status.Status(f"{title}: compiling", console=console)
        self._title = title
        self._headed = False

    def __enter__(self) -> "FitDisplay":
        self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._status.stop()

    def show(self, progress: Progress) -> None:
        """One line: how far, how good, how long."""
        if not self._headed:
            self._headed = True
            console.print(f"{'step':>6} {'chi^2/N':>12} {'damping':>10} {'seconds':>8}")
        taken = "" if not progress.rejected_in_a_row else "  rejected"
        console.print(
            f"{progress.iteration:6d} {2 * progress.cost:12.6g} {1 / progress.step_size:10.3g} "
            f"{time.monotonic() - self._began:8.1f}{taken}"
        )
        self._status.update(f"{self._title}: step {progress.iteration + 1}")

    def wait(self, what: str) -> None:
        """Says what is being waited for."""
        self._status.update(f"{self._title}: {what}")
