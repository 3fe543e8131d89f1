"""Populations of actuators: who varies how, and experiments on many at once."""

from ._evaluate import LANES as LANES, Evaluator as Evaluator, Results as Results
from ._factors import Factors as Factors, check_known as check_known, choose_factors as choose_factors
from ._fitted import fitted_levels as fitted_levels, fitted_population as fitted_population
from ._population import (
    Margin as Margin,
    Population as Population,
    domain as domain,
    lognormal as lognormal,
    normal as normal,
    triangular as triangular,
    uniform as uniform,
)
