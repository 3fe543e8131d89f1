"""Sensitivity analysis: samples, indices with intervals from one set of simulations, and what they say together."""

from ._correlation import correlations as correlations, squared_correlation as squared_correlation
from ._design import RadialDesign as RadialDesign
from ._indices import (
    Indices as Indices,
    LinearIndices as LinearIndices,
    analyse as analyse,
    analyse_linear as analyse_linear,
    complete_groups as complete_groups,
)
from ._local import NORMAL as NORMAL, UNIFORM as UNIFORM, gradient_share as gradient_share, total_bound as total_bound
from ._moments import variance as variance
from ._morris import ElementaryEffects as ElementaryEffects, elementary_effects as elementary_effects
from ._named import NamedIntervals as NamedIntervals
from ._ranking import (
    Interval as Interval,
    RankedInput as RankedInput,
    Ranking as Ranking,
    Rankings as Rankings,
    Verdict as Verdict,
    explain as explain,
    rank_inputs as rank_inputs,
)
from ._regression import Regression as Regression, regress as regress
from ._resampling import BootstrapInterval as BootstrapInterval, bootstrap as bootstrap
from ._second_order import (
    damping_ratio as damping_ratio,
    frictionless_diaphragm as frictionless_diaphragm,
    natural_frequency as natural_frequency,
    step_response as step_response,
)
from ._sliding import (
    force_along as force_along,
    parameter_slopes as parameter_slopes,
    starting_force as starting_force,
    steady_force as steady_force,
)
from ._sobol import first_order as first_order, total_order as total_order
