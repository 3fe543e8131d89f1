"""Closed loops in summaries and reports: the plants along a course, the worst of each, and all in one picture."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from jaxtyping import Float

from vgtjax.tuning import Case, Figures

from .figures import numbered, points, styled
from .files import finite

Summaries = Mapping[str, tuple[str, Callable[[np.ndarray], float]]]
"""By its name in a row, a figure and what is made of those of all plants."""
ERRORS: Summaries = {"rms_median": ("rms", np.median), "rms_worst": ("rms", np.max), "peak": ("peak", np.max)}


def along_each(labels: Sequence[Case]) -> list[tuple[dict[str, Any], list[int]]]:
    """What a row begins with for each course at each turbine pressure in Pa gauge, and the places of its loops."""
    return [
        ({"reference": course, "turbine_pressure": pressure, "plants": len(places)}, places)
        for (course, pressure), places in _places(labels, lambda label: (label.course, label.turbine_pressure)).items()
    ]


def of_plants(figures: Figures, places: Sequence[int], summaries: Summaries) -> dict[str, Any]:
    """Figures of the closed loops at some places that did not fail, in SI units, and how many did; `None` where all."""
    good = [place for place in places if not figures.failed[place]]
    return {"failed": len(places) - len(good)} | {
        name: finite(summary(getattr(figures, figure)[good])) if good else None
        for name, (figure, summary) in summaries.items()
    }


def worst_of_each(labels: Sequence[Case], figure: Float[np.ndarray, " cases"]) -> list[int]:
    """For each course the place where a figure is largest; a closed loop that failed goes before all others."""
    sizes = np.nan_to_num(figure, nan=np.inf)
    return [max(each, key=lambda i: sizes[i]) for each in _places(labels, lambda label: label.course).values()]


def _places(labels: Sequence[Case], key: Callable[[Case], Any]) -> dict[Any, list[int]]:
    found: dict[Any, list[int]] = {}
    for place, label in enumerate(labels):
        found.setdefault(key(label), []).append(place)
    return found


def spread_figure(
    labels: Sequence[Case],
    errors: Iterable[tuple[str, Float[np.ndarray, " cases"], str, str]],
    by: tuple[str, Float[np.ndarray, " cases"]],
) -> go.Figure:
    """Errors of all closed loops, sorted by one of them.

    **Arguments:** of each kind of error its name, itself in m, a colour and a symbol; `by`: name and error in m.
    """
    order = np.argsort(np.nan_to_num(by[1], nan=np.inf), kind="stable")
    places, hovertext, figure = np.arange(len(order)), [str(labels[i]) for i in order], go.Figure()
    for name, values, color, symbol in errors:
        figure.add_trace(points(places, 1e6 * values[order], name, color, 6, symbol=symbol, hovertext=hovertext))
    figure.update_yaxes(type="log")
    numbered(figure, len(order))
    return styled(figure, 380, f"closed loop, sorted by its {by[0]}", "error, um", hovermode="closest")
