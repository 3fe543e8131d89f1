"""The steps of a fit, whose errors its corrections take away."""

from ..plants import AbstractModel
from ..simulation import FixedMarch, FixedStep

SLOW, LONGER = 5e-3, 2.0
"""s between samples from which steps are so many times as long. Four units of twenty with loops at 100 Hz come out the
same to 0.03 to 0.15 standard errors in the root mean square of 51 values, errors to a hundredth, in as many steps of
the search, and each derivative of a loop costs half."""


class StepsOfFit(FixedStep):
    """Steps of a fit that corrects for numerical errors: longer where a trace is sampled so rarely that most of the
    time goes into what happens between two samples."""

    def plan_intervals(self, model: AbstractModel, longest_interval: float) -> FixedMarch:
        """See the base class."""
        longest = self.max_step * (LONGER if longest_interval >= SLOW else 1.0)
        return FixedStep(longest, self.solver).plan_intervals(model, longest_interval)
