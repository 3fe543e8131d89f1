"""Sensitivity analysis: samples, indices with intervals from one set of simulations, and what they say together."""

from .base import Sample as Sample
from .correlation import correlations as correlations, squared_correlation as squared_correlation
from .design import RadialDesign as RadialDesign
from .indices import (
    Indices as Indices,
    LinearIndices as LinearIndices,
    analyse as analyse,
    analyse_linear as analyse_linear,
)
from .local import NORMAL as NORMAL, UNIFORM as UNIFORM, gradient_share as gradient_share, total_bound as total_bound
from .moments import variance as variance
from .morris import ElementaryEffects as ElementaryEffects, elementary_effects as elementary_effects
from .ranking import (
    Interval as Interval,
    RankedInput as RankedInput,
    Ranking as Ranking,
    Verdict as Verdict,
    explain as explain,
    judge as judge,
    rank_inputs as rank_inputs,
)
from .regression import Regression as Regression, regress as regress
from .resampling import Estimate as Estimate, bootstrap as bootstrap
from .sampling import LatinHypercubeSample as LatinHypercubeSample, SobolSample as SobolSample
from .sobol import first_order as first_order, total_order as total_order
