"""What a fit says of the misfit around its end."""

from typing import Any

from vgtjax.estimation import Slices

from ..output.files import finite

LEAST_LOADING = 0.1
"""Loadings below this are left out of `summary.json`: a hundredth of a variance."""


def slice_summary(slices: Slices) -> list[dict[str, Any]]:
    """Every slice: its values at `reaches` in standard errors, `None` where a simulation failed."""
    return [
        {
            "direction": each.direction,
            "loadings": {name: value for name, value in each.loadings.items() if abs(value) >= LEAST_LOADING},
            "reaches": list(each.reaches),
            "values": finite(each.values),
            "carried_by": each.carried_by,
            "verdict": each.verdict,
        }
        for each in slices.slices
    ]
