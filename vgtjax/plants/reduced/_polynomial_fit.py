"""The polynomial flow map by least squares, with slopes that may not rise."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...parts import FULL_DUTY, PolynomialFlow

Samples = Float[np.ndarray, " samples"]


def fit_polynomial_flow(
    duty: Samples,
    pressure: Samples,
    flow: Samples,
    weight: Samples,
    *,
    pressure_range: tuple[float, float],
    ambient: float,
) -> PolynomialFlow:
    """[5.10] by weighted least squares, such that flow rises neither with duty nor with pressure anywhere in the range.

    **Arguments:** `duty` in percent, `pressure` in Pa absolute at the atmosphere `ambient`, `flow` in kg/s.
    """
    # Here, since it takes a third of a second that no simulation needs.
    from scipy.optimize import lsq_linear

    low, high = pressure_range
    columns = [np.ones_like(duty)]
    for share in (duty / FULL_DUTY, (pressure - low) / (high - low)):
        columns += [share**2 / 2 - share, -(share**2) / 2]
    basis = np.stack(columns, axis=1) * weight[:, None]
    size = float(np.max(np.abs(flow)))
    found = lsq_linear(basis, flow / size * weight, ([-np.inf, 0, 0, 0, 0], np.inf), method="bvls").x
    level, u0, u1, p0, p1 = size * found
    share_of = np.polynomial.Polynomial([-low / (high - low), 1 / (high - low)])
    return PolynomialFlow(
        pressure=jnp.asarray(np.polynomial.Polynomial([level, -p0, (p0 - p1) / 2])(share_of).coef),
        duty=jnp.asarray([-u0 / FULL_DUTY, (u0 - u1) / 2 / FULL_DUTY**2]),
        ambient=ambient,
        pressure_range=(low, high),
    )
