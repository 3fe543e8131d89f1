"""What notebooks draw again and again: tables, shares of a variance, errors of closed loops."""

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import HTML
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibrate.reproduction import Result
from vgtjax.control import ClosedLoop
from vgtjax.sensitivity import Rankings
from vgtjax.tuning import Case

STYLE = {"figure.dpi": 76, "axes.grid": True, "grid.alpha": 0.3, "figure.constrained_layout.use": True}
VERDICTS = {"reproduced": "green", "differs": "firebrick"}
"""Colour of a verdict; gray for all others."""
INDICES = {
    "correlation": ("(4.1)", "0.6"),
    "regression": ("regression²", "0.4"),
    "first": ("first order", "C0"),
    "total": ("total", "C3"),
    "local": ("gradient", "C2"),
}
"""Label and colour of each index of a ranking."""
PRESSURES = {0.0: "C0", 1.5e5: "C1", 3e5: "C3"}
"""Colour of a turbine pressure in Pa."""


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], colors: Sequence[str] | None = None) -> HTML:
    """Rows of texts, the last but one of each in a colour of its own if there are any."""
    lines = ["<tr>" + "".join(f"<th>{html.escape(head)}</th>" for head in heads) + "</tr>"]
    for number, row in enumerate(rows):
        styles = ["text-align: left"] * len(row)
        if colors is not None:
            styles[-2] += f"; color: {colors[number]}"
        cells = (f"<td style='{style}'>{html.escape(cell)}</td>" for style, cell in zip(styles, row, strict=True))
        lines.append("<tr>" + "".join(cells) + "</tr>")
    return HTML("<table>" + "".join(lines) + "</table>")


def verdicts(results: Sequence[Result]) -> HTML:
    """Statements of the thesis beside ours."""
    heads = ("section", "statement", "printed", "ours", "verdict", "why")
    rows = [
        (each.row.section.split()[0], each.row.quantity, each.row.printed, each.text, each.verdict, each.reason)
        for each in results
    ]
    return table(heads, rows, [VERDICTS.get(each.verdict, "gray") for each in results])


def shares(axis: Axes, over: np.ndarray, parts: Any, labels: Iterable[str], colors: Iterable[str]) -> None:
    """Shares of a variance, stacked over time or speed."""
    axis.stackplot(over, parts, labels=list(labels), colors=list(colors), alpha=0.75)
    axis.set(ylabel="share of the variance", xlim=(over[0], over[-1]), ylim=(0, 1))
    axis.legend(framealpha=0.9)


def rankings(found: Rankings, titles: Mapping[str, str], leading: int = 4) -> Figure:
    """Every index of the quantities that lead each output, with its interval."""
    figure, axes = plt.subplots(2, 3, figsize=(11, 6.2), sharey=True)
    for axis, (name, title) in zip(axes.flat, titles.items(), strict=True):
        entries = found[name].inputs[:leading]
        for number, (kind, (label, color)) in enumerate(INDICES.items()):
            intervals = [getattr(entry, kind) for entry in entries]
            ends = np.array([[max(i.value - i.low, 0), max(i.high - i.value, 0)] for i in intervals]).T
            place, values = np.arange(leading) + 0.16 * (number - 2), [interval.value for interval in intervals]
            axis.bar(place, values, 0.14, yerr=ends, color=color, label=label, error_kw={"lw": 0.7})
        texts = [entry.name.replace(".", ".\n").replace("_", "\n") for entry in entries]
        axis.set_xticks(range(leading), texts, fontsize=7)
        axis.set_title(f"{title} (R² = {found[name].r2:.2f})", fontsize=9)
    axes[0, 0].legend(fontsize=7)
    for axis in axes[:, 0]:
        axis.set_ylabel("share of variance")
    return figure


def loop_errors(axes: Sequence[Axes], run: ClosedLoop, labels: Sequence[Case], **style: Any) -> None:
    """Errors of many closed loops over time, a panel for each reference, a colour for each turbine pressure."""
    names = list(dict.fromkeys(label.reference for label in labels))
    for number, label in enumerate(labels):
        color, error = PRESSURES[label.turbine_pressure], 1e6 * np.asarray(run.error[number])
        axes[names.index(label.reference)].plot(run.time[number], error, color, lw=0.6, alpha=0.8, **style)
    for axis, name in zip(axes, names, strict=True):
        axis.set(title=name, xlabel="time, s", ylabel="error, µm")
    pressures = sorted({label.turbine_pressure for label in labels})
    lines = [plt.Line2D([], [], color=PRESSURES[at], label=f"{at / 100:.0f} mbar") for at in pressures]
    axes[0].legend(handles=lines)
