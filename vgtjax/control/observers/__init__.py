"""What is observed instead of measured: velocity, chamber pressure, friction and load."""

from ._differentiator import (
    AbstractDifferentiator as AbstractDifferentiator,
    FilteredDifference as FilteredDifference,
    ImplicitLevantDifferentiator as ImplicitLevantDifferentiator,
    LevantDifferentiator as LevantDifferentiator,
)
from ._friction_observer import (
    DualFrictionObserver as DualFrictionObserver,
    FrictionEstimate as FrictionEstimate,
    nominal_coefficients as nominal_coefficients,
    regressors as regressors,
)
from ._load_observer import LoadEstimate as LoadEstimate, LoadObserver as LoadObserver, transition as transition
from ._pressure_observer import ObservedState as ObservedState, PressureObserver as PressureObserver
