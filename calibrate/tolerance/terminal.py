"""What `tolerance` says in the terminal: how every output spreads, and how many samples keep its limits."""

from typing import Any

import rich.table

from ..output.console import plain_table

MOST = "0.95"
"""The quantile that is shown."""


def table(summary: dict[str, Any]) -> rich.table.Table:
    """A row for each output; blank where nothing is to be said."""
    shown = plain_table(("output", "unit", "nominal", "mean", "deviation", "95 % below", "keep the limit"))
    for name, found in summary["outputs"].items():
        figures = (found["nominal"], found["mean"], found["deviation"], found["quantiles"][MOST])
        cells = ("" if figure is None else f"{figure:.4g}" for figure in figures)
        shown.add_row(name, found["unit"], *cells, share(found.get("yield")))
    return shown


def share(found: dict[str, float] | None) -> str:
    """The part of the samples, with its interval."""
    if found is None:
        return ""
    return f"{100 * found['share']:.1f} % ({100 * found['low']:.1f} to {100 * found['high']:.1f})"
