"""One number that a fit moved, and what is known of it."""

import dataclasses
import math
from collections.abc import Mapping

from .._printing import Cells


@dataclasses.dataclass(frozen=True)
class Estimate:
    """What a fit found of one entry, in the `unit` of the table; by default as of one that was held.

    `interval` has the ends within which the value lies with 95 % confidence. A `std_error` and both ends are NaN where
    the data say nothing; one end is infinite where it is open. `at_bound`: the value lies on a bound; `determined`: the
    traces tell it, a positive one to a factor of ten to either side at least.
    """

    value: float
    unit: str
    std_error: float = math.nan
    interval: tuple[float, float] = (math.nan, math.nan)
    at_bound: bool = False
    determined: bool = False


def estimate_table(estimates: Mapping[str, Estimate]) -> Cells:
    """A row of texts for every entry below a header."""
    rows = [("parameter", "value", "std. error", "unit", "")]
    for entry, found in estimates.items():
        status = "at bound" if found.at_bound else "free" if found.determined else "not determined"
        error = f"{found.std_error:.2g}" if math.isfinite(found.std_error) else ""
        rows.append((entry, f"{found.value:.6g}", error, found.unit, status))
    return rows
