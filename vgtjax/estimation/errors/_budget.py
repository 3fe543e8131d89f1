"""Where the errors of fitted values come from: a budget of parts of type A and B, as the GUM asks for (JCGM 100)."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

Errors = Float[np.ndarray, " entries"]


@dataclasses.dataclass(frozen=True, eq=False)
class Budget:
    """Parts of standard errors, each in the unit of its entry; NaN where the data say nothing.

    Their squares add up to that of the standard error. Type A, by the statistics of the traces: `noise`, as it and its
    colour were found, and `scatter`, of corrections that go to and fro, and of those that
    answer a late duty less than derivatives promise. Type B, by what is known from elsewhere:
    `moved`, by source, is how far each value moves when what is held, or the gain of a sensor, is off by its
    uncertainty, with its sign; and how far, without one, when the pressure that drives a rod is measured once more, or
    along what the sharp model answers less than derivatives of slow traces promise; and between both readings of a duty
    whose hold is not decided.

    `windowed` checks `noise` and is no further part: the same from sums of residuals over windows of `window` seconds,
    which believes nothing of the noise but that it forgets within that time.
    """

    noise: Errors
    scatter: Errors
    moved: Mapping[str, Errors]
    windowed: Errors
    window: float

    @property
    def excess(self) -> float:
        """Errors by windows over those by the noise as it was found, in the median; NaN where nothing is known."""
        known = np.isfinite(self.noise) & (self.noise > 0)
        return float(np.median(self.windowed[known] / self.noise[known])) if np.any(known) else np.nan

    @property
    def type_a(self) -> Errors:
        """Combined parts of type A."""
        return np.hypot(self.noise, self.scatter)

    @property
    def type_b(self) -> Errors:
        """Combined parts of type B."""
        return np.sqrt(np.sum([np.square(each) for each in self.moved.values()], axis=0) + 0.0 * self.noise)

    @property
    def combined(self) -> Errors:
        """The standard errors that the parts make."""
        return np.hypot(self.type_a, self.type_b)
