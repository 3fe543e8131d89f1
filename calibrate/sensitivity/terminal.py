"""What `sensitivity` says in the terminal: the quantities that each output's spread comes from."""

from typing import Any

NAMED = 3
"""Quantities of an output; the report has all."""


def lines(summary: dict[str, Any]) -> list[str]:
    """An output each, with the largest total indices and their intervals."""
    outputs = ((name, found["quantities"][:NAMED]) for name, found in summary["outputs"].items())
    return ["total index, with its interval:", *(f"  {name}: {_most(rows)}" for name, rows in outputs)]


def _most(rows: list[dict[str, Any]]) -> str:
    known = [(row["quantity"], row["total"]) for row in rows if row["total"]["value"] is not None]
    said = (f"{name} {total['value']:.2f} ({total['low']:.2f} to {total['high']:.2f})" for name, total in known)
    return ", ".join(said) or "too few complete samples"
