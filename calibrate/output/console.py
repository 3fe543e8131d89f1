"""What a user sees while a command works."""

from collections.abc import Iterable

import rich.console
import rich.table

from vgtjax import Trace

console = rich.console.Console(highlight=False, markup=False, soft_wrap=True)
WIDE = 120
"""Width that a table may have: in a narrower terminal its rows go on in the next line, but no digit is cut off."""


def say(part: rich.table.Table | str) -> None:
    """A sentence, or a table with all of its digits."""
    rich.console.Console(highlight=False, markup=False, soft_wrap=True, width=max(console.width, WIDE)).print(part)


def plain_table(names: Iterable[str]) -> rich.table.Table:
    """A table without lines: a column of names, and columns of figures."""
    shown = rich.table.Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for column, name in enumerate(names):
        shown.add_column(name, no_wrap=True, justify="right" if column else "left")
    return shown


def say_notes(traces: Iterable[Trace]) -> None:
    """What loading the traces assumed or ignored."""
    for trace in traces:
        for note in trace.notes:
            console.print(f"note: {trace.name}: {note}")
