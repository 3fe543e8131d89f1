"""Budget of the errors of a fit: parts of type A and B of every value, as files and reports have it."""

import dataclasses
from typing import Any

import numpy as np

from vgtjax.estimation import Calibration


@dataclasses.dataclass(frozen=True)
class BudgetRow:
    """Parts of one standard error in the unit of the table; `moved` by source, with its sign."""

    name: str
    unit: str
    noise: float
    scatter: float
    moved: dict[str, float]
    combined: float
    windowed: float

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "type_a": {"noise": self.noise, "scatter_of_corrections": self.scatter},
            "type_b": self.moved,
            "combined": self.combined,
            "noise_by_windows": self.windowed,
        }


def budget_rows(calibration: Calibration) -> list[BudgetRow]:
    """Of every value that the traces determine."""
    budget, rows = calibration.budget, []
    for number, (name, found) in enumerate(calibration.estimates.items()):
        noise, scatter = float(budget.noise[number]), float(budget.scatter[number])
        moved = {source: float(each[number]) for source, each in budget.moved.items()}
        combined, windowed = float(budget.combined[number]), float(budget.windowed[number])
        row = BudgetRow(name, found.unit, noise, scatter, moved, combined, windowed)
        if np.isfinite(row.combined):
            rows.append(row)
    return rows
