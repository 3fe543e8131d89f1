"""The command `reproduce`: what the thesis states in chapters 2 to 5 beside what we get."""

import collections
import hashlib
import importlib.metadata
import itertools
import pathlib

import rich.status

from ..output.console import console
from ..output.files import REPORT, write_json, write_text
from ..output.page import render_page
from ..resumable import run_once
from . import MEANING, ROWS, Result, Verdict, evaluate, figures

WIDTH = max(len(verdict) for verdict in MEANING)
"""Letters of the longest verdict."""


def run(out: pathlib.Path) -> None:
    """Writes `reproduction.json` and `report.html`; does nothing where an earlier run wrote them.

    **Raises:** `InputError` when the folder belongs to something else.
    """
    run_once(out, "reproduce", _fingerprint(), lambda: _compute(out))


def _compute(out: pathlib.Path) -> None:
    results = []
    with rich.status.Status("reproduce", console=console) as status:
        for result in evaluate():
            results.append(result)
            console.print(f"{result.verdict:{WIDTH}} {result.row.quantity}")
        status.update("reproduce: writing the report")
        write_json(out / "reproduction.json", [result.to_json() for result in results])
        write_text(out / REPORT, render(results))
    for verdict, count in _counted(results).items():
        console.print(f"{count:4} {verdict}")


def _counted(results: list[Result]) -> dict[Verdict, int]:
    """How many rows have each verdict, in the order of [`MEANING`][]."""
    counts = collections.Counter(result.verdict for result in results)
    return {verdict: counts[verdict] for verdict in MEANING}


def _fingerprint() -> str:
    """Of all statements and of this version: what a folder's table depends on."""
    statements = [(row.id, row.kind.name, row.printed, str(row.rule)) for row in ROWS]
    return hashlib.sha256(f"{importlib.metadata.version('vgtjax')} {statements}".encode()).hexdigest()


def render(results: list[Result]) -> str:
    """The report as HTML: the table by section, and a few pictures."""
    sections = [
        (name, list(group)) for name, group in itertools.groupby(results, key=lambda result: result.row.section)
    ]
    return render_page(
        "reproduction.html.jinja",
        title="Chapters 2 to 5 of the thesis, checked",
        sections=sections,
        meaning=MEANING,
        counts=_counted(results),
        figures=[(title, text, draw()) for title, text, draw in figures.ALL],
    )
