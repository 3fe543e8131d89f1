"""Where the errors of fitted values come from, and how well they leave a trace known."""

from ._bands import Bands as Bands, predicted_spread as predicted_spread
from ._budget import Budget as Budget
from ._exact import taken_for_exact as taken_for_exact
from ._granted import by_gains as by_gains, uncertain_gains as uncertain_gains
