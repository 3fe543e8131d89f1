"""What good control costs: tracking, effort, chatter and limits in one number, over many closed loops."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError, is_traced
from .._types import Scalar
from ..control import ClosedLoop, number
from ..parts import falling_root

TERMS = ("tracking", "effort", "chatter", "limit")
"""Parts of the cost of one closed loop, in the order of every array of them."""

SHARPNESS = 0.02
"""Of the mean cost: over it, a cost gradually counts as beyond a quantile."""


class Objective(eqx.Module):
    """A cost of closed loops, the less the better. Of one closed loop, from `settled` seconds on,

        l = mean (e/tracking)^2 + mean (u/effort)^2 + mean (du/chatter)^2
            + penalty mean (max(|e| - largest_error, 0)/tracking)^2

    with the true error `e` in m, the duty `u` in percent and its change `du` from one sample to the next: each scale
    says what is worth one, and an infinite one leaves a term out. Of all closed loops together

        J = (1 - worst) mean l + worst (mean l^power)^(1/power)

    The power mean tends to the worst case as `power` grows; with 8, the worst of sixty counts within a factor of 1.7.
    With a `quantile` below one the mean of the costs beyond that quantile stands in its place, which chance in a
    single loop moves less (expected shortfall).

    **Raises:** `InputError` for a scale that is not positive, a share outside 0 to 1, or a power below one.
    """

    tracking: Scalar = number(default=1e-5)
    effort: Scalar = number(default=math.inf)
    chatter: Scalar = number(default=math.inf)
    largest_error: Scalar = number(default=math.inf)
    penalty: Scalar = number(default=10.0)
    worst: Scalar = number(default=0.5)
    power: Scalar = number(default=8.0)
    quantile: float = eqx.field(static=True, default=1.0)
    settled: float = eqx.field(static=True, default=2.0)

    def __check_init__(self) -> None:
        rules = [(name, lambda v: v > 0, "positive") for name in ("tracking", "effort", "chatter", "largest_error")]
        rules += [("penalty", lambda v: v >= 0, "zero or positive"), ("settled", lambda v: v >= 0, "zero or positive")]
        rules += [("worst", lambda v: 0 <= v <= 1, "within 0 and 1"), ("power", lambda v: v >= 1, "one or more")]
        rules += [("quantile", lambda v: 0 < v <= 1, "above 0 and at most 1")]
        for name, holds, rule in rules:
            value = getattr(self, name)
            if not is_traced(value) and not holds(float(np.asarray(value))):
                raise InputError(f"{name} of an objective must be {rule}, but it is {value}; correct it")

    def residuals(self, run: ClosedLoop) -> Float[Array, "terms time"]:
        """Numbers whose squares add up to `l`, a row for each of [`TERMS`][]."""
        counted = run.time >= self.settled
        share = jnp.sqrt(counted / jnp.maximum(jnp.sum(counted), 1))
        error = run.error
        excess = jnp.sign(error) * jnp.maximum(jnp.abs(error) - self.largest_error, 0.0)
        change = jnp.diff(run.duty, prepend=run.duty[:1])
        rows = [
            error / self.tracking,
            run.duty / self.effort,
            change / self.chatter,
            jnp.sqrt(self.penalty) * excess / self.tracking,
        ]
        return share[None, :] * jnp.stack(rows)

    def combine(self, costs: Float[Array | np.ndarray, " cases"]) -> Scalar:
        """`J` of the cost of every closed loop: convex, rises with each of them, and has two derivatives."""
        if self.quantile < 1:
            return (1 - self.worst) * jnp.mean(costs) + self.worst * mean_beyond(costs, self.quantile)
        # Divided by the largest, so that no power overflows.
        largest = jnp.maximum(jnp.max(costs), jnp.finfo(costs.dtype).tiny)
        mean_power = jnp.mean((costs / largest) ** self.power)
        return (1 - self.worst) * jnp.mean(costs) + self.worst * largest * mean_power ** (1 / self.power)

    def derivatives(
        self, costs: Float[np.ndarray, " cases"]
    ) -> tuple[Float[np.ndarray, " cases"], Float[np.ndarray, "cases cases"]]:
        """First and second derivatives of `J` with respect to the cost of every closed loop."""
        first, second = _derivatives(self, jnp.asarray(costs))
        return np.asarray(first), np.asarray(second)


def mean_beyond(costs: Float[Array | np.ndarray, " cases"], quantile: float) -> Scalar:
    """Mean of the costs beyond a quantile, smoothed: Rockafellar and Uryasev's (2000) expected shortfall,

        min over t of  t + mean w log(1 + exp((l - t)/w)) / (1 - quantile),   w = mean l / 50

    which is convex in the costs and rises with each, as the sharp one for `w = 0`; it is higher by at most
    `w log 2 / (1 - quantile)`.
    """
    width = SHARPNESS * jnp.maximum(jnp.mean(costs), jnp.finfo(costs.dtype).tiny)
    scaled = jnp.asarray(costs) / width
    level = _level(scaled, quantile)
    return width * (level + jnp.mean(jax.nn.softplus(scaled - level)) / (1 - quantile))


def _level(scaled: Float[Array, " cases"], quantile: float) -> Scalar:
    """The `t/w` beyond which a share of the costs lies, with the derivatives of what solves the equation."""

    def missing(level: Scalar) -> Scalar:
        return jnp.mean(jax.nn.sigmoid(scaled - level)) - (1 - quantile)

    still, reach = jax.lax.stop_gradient(scaled), abs(math.log(1 / quantile - 1)) + 1
    return falling_root(missing, jnp.min(still) - reach, jnp.max(still) + reach)


@eqx.filter_jit
def _derivatives(objective: Objective, costs: Float[Array | np.ndarray, " cases"]) -> tuple[Array, Array]:
    return jax.grad(objective.combine)(costs), jax.hessian(objective.combine)(costs)
