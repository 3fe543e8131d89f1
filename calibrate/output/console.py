"""What a user sees while a command works."""

from collections.abc import Iterable

import rich.console

from vgtjax import Trace

console = rich.console.Console(highlight=False, markup=False, soft_wrap=True)


def say_notes(traces: Iterable[Trace]) -> None:
    """What loading the traces assumed or ignored."""
    for trace in traces:
        for note in trace.notes:
            console.print(f"note: {trace.name}: {note}")
