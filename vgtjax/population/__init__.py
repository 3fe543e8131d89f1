"""Populations of actuators: who varies how, and experiments on many at once."""

from .evaluate import LANES as LANES, Evaluator as Evaluator, Results as Results
from .factors import Factors as Factors, choose_factors as choose_factors
from .fitted import fitted_levels as fitted_levels, fitted_population as fitted_population
from .population import (
    Population as Population,
    domain as domain,
    lognormal as lognormal,
    normal as normal,
    triangular as triangular,
    uniform as uniform,
)
