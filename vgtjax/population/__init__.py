"""Populations of actuators: who varies how, samples of them, and experiments on many at once."""

from ._common_knots import FittedUnit as FittedUnit
from ._evaluate import Evaluator as Evaluator, run as run
from ._factors import (
    Factors as Factors,
    PassiveFactors as PassiveFactors,
    choose_factors as choose_factors,
    differing_factors as differing_factors,
)
from ._fitted import (
    fitted_levels as fitted_levels,
    fitted_population as fitted_population,
    population_of_fits as population_of_fits,
    population_of_units as population_of_units,
)
from ._members import Members as Members
from ._population import (
    Margin as Margin,
    Population as Population,
    lognormal as lognormal,
    normal as normal,
    triangular as triangular,
    uniform as uniform,
)
from ._results import (
    CAUSES as CAUSES,
    Description as Description,
    Gradients as Gradients,
    OutputTable as OutputTable,
    Results as Results,
    column_names as column_names,
    describe as describe,
)
from ._sampling import (
    MOST_ROWS as MOST_ROWS,
    LatinHypercubeSample as LatinHypercubeSample,
    Sample as Sample,
    SobolSample as SobolSample,
    check_size as check_size,
    make_sample as make_sample,
    sobol_points as sobol_points,
)
from ._spread import Spread as Spread, spread_population as spread_population
from ._yield import Limits as Limits, Yield as Yield, keeps as keeps, yield_of as yield_of
