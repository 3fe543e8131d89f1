"""What a report says of the misfit around the end of a fit."""

import itertools
from typing import Any

import numpy as np
import plotly.graph_objects as go

from vgtjax.estimation import Around, Slices

from ..output import figures
from ..output.files import finite

LEAST_LOADING = 0.1
"""Loadings below this are left out of `summary.json`, but for the largest: a hundredth of a variance."""


def summarise(around: Around) -> dict[str, Any]:
    """Slices and profiles with their values at `reaches` in standard errors, `None` where a simulation failed."""
    slices = [
        {
            "direction": each.direction,
            "loadings": {
                name: value
                for name, value in each.loadings.items()
                if abs(value) >= LEAST_LOADING or name in each.carried_by
            },
            "reaches": list(each.reaches),
            "values": finite(each.values),
            "shift": each.shift,
            "verdict": each.verdict,
        }
        for each in around.slices.slices
    ]
    profiles = {
        name: {
            "reaches": list(each.reaches),
            "values": finite(each.values),
            "ends": finite(each.ends),
            "verdict": each.verdict,
        }
        for name, each in around.profiles.profiles.items()
    }
    counts = {"slices": around.slices.left_out, "profiles": around.profiles.left_out}
    evaluations = {"slices": around.slices.evaluations, "profiles": around.profiles.evaluations}
    return {"slices": slices, "profiles": profiles, "not_looked_at": counts, "evaluations": evaluations}


def slices_figure(slices: Slices) -> go.Figure:
    """All slices over each other; those that are no parabolas have their names."""
    figure = go.Figure()
    reach = np.linspace(-2.0, 2.0, 81)
    figure.add_trace(figures.curve(reach, reach**2, "parabola", figures.MEASURED, width=6, opacity=0.4))
    same = [each for each in slices.slices if each.is_parabola]
    pairs = [pair for each in same for pair in zip(each.reaches, each.values, strict=True)]
    x, y = np.reshape(pairs, (-1, 2)).T
    figure.add_trace(figures.points(x, y, "parabolas", figures.DUTY, 5, opacity=0.6))
    for each, color in zip(slices.no_parabolas, itertools.cycle(figures.PALETTE), strict=False):
        x, y = np.transpose(sorted([*zip(each.reaches, each.values, strict=True), (0.0, 0.0)]))
        shown = np.where(np.isfinite(y), y, np.nan)
        name = f"{each.direction}: {each.carried_by[0]}, {each.verdict}"
        figure.add_trace(figures.curve(x, shown, name, color, mode="lines+markers"))
    return figures.styled(figure, 380, "standard errors", "rise of chi^2", hovermode="closest")
