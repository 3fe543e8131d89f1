"""The steps of a fit, whose errors its corrections take away."""

import equinox as eqx
import numpy as np

from ...plants import AbstractModel
from ...simulation import AbstractFixedStepping, FixedMarch, FixedStep
from ...traces import Trace

RARE, GENTLE, LONGER = 5e-3, 1.0, 2.0
"""s between samples, and percent of the duty from one to the next at most, from and up to which steps are so many times
as long. Four units of twenty with loops at 100 Hz come out the same to 0.03 to 0.15 standard errors in the root mean
square of 51 values, errors to a few percent, in as many steps of the search, and each derivative of a loop costs half.
Of records whose duty jumps 100 times a second, derivatives by the plunger's scale need the shorter steps: with longer
ones, twice its time constant, they told that to half as well."""


class StepsOfFit(AbstractFixedStepping):
    """Steps of a fit that corrects for numerical errors: longer for a trace of slow motion that is sampled so rarely
    that most of the time goes into what happens between two samples, of a model that the duty drives."""

    usual: FixedStep = eqx.field(default_factory=FixedStep)

    def plan(self, model: AbstractModel, trace: Trace) -> FixedMarch:
        """See the base class."""
        longer = LONGER if lengthens(model, trace) else 1.0
        return FixedStep(longer * self.usual.max_step, self.usual.solver).plan(model, trace)

    def plan_intervals(self, model: AbstractModel, longest_interval: float) -> FixedMarch:
        """The usual steps: of intervals alone nobody knows how slow they are."""
        return self.usual.plan_intervals(model, longest_interval)


def lengthens(model: AbstractModel, trace: Trace) -> bool:
    """Whether a fit takes longer steps along a trace."""
    duty = trace.pwm if "pwm" in model.needs else None
    slow = duty is not None and float(np.max(np.abs(np.diff(duty)), initial=0.0)) <= GENTLE
    return slow and bool(trace.longest_interval >= RARE)
