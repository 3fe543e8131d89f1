"""The integration method: Heun's, kept stable where damping is faster than the step can follow."""

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp

from ..plants import State


class StabilisedHeun(diffrax.AbstractSolver):
    """Heun's method with the excess of fast damping taken implicitly.

    Of each state's relaxation rate, the part beyond `limit / h` is integrated by a rational ETD2RK (Cox and Matthews,
    2002), which is L-stable; without excess this is exactly Heun's method. The manual's page on estimation has the
    reasons.
    """

    relaxation: Callable[[Any, Any, Any], Any]
    """Rates in 1/s of `(t, y, args)`, shaped like the state, `None` where a state is slow."""
    limit: float = 1.5

    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def order(self, terms: diffrax.AbstractTerm) -> int:
        """Two."""
        return 2

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: Any) -> None:
        """No state."""
        return

    def func(self, terms: diffrax.AbstractTerm, t0: Any, y0: State, args: Any) -> State:
        """The vector field."""
        return terms.vf(t0, y0, args)

    def step(
        self, terms: diffrax.AbstractTerm, t0: Any, t1: Any, y0: State, args: Any, solver_state: None, made_jump: Any
    ) -> tuple[State, State, dict[str, State], None, Any]:
        """One step from `t0` to `t1`, with the difference to Euler's step as error estimate."""
        h = terms.contr(t0, t1)
        # `None` is a leaf of the rates where the state has a number, so the state's structure leads.
        excess = jax.tree.map(lambda y, rate: _Excess(h, rate, self.limit), y0, self.relaxation(t0, y0, args))
        slope0 = terms.vf(t0, y0, args)
        euler = jax.tree.map(lambda y, k, e: e.predict(y, h * k), y0, slope0, excess)
        slope1 = terms.vf(t1, euler, args)
        y1 = jax.tree.map(lambda y, a, k0, k1, e: e.correct(y, a, h * (k1 - k0)), y0, euler, slope0, slope1, excess)
        error = jax.tree.map(jnp.subtract, y1, euler)
        return y1, error, dict(y0=y0, y1=y1), None, diffrax.RESULTS.successful


class _Excess:
    """The two stages for one state, given how far `h * rate` exceeds the limit.

    Weights end in a division: XLA computes one of those once, and anything cheaper anew for every tangent.
    """

    def __init__(self, h: Any, rate: Any, limit: float):
        self.z = None if rate is None else jnp.maximum(h * rate - limit, 0.0)

    def predict(self, y: Any, increment: Any) -> Any:
        if self.z is None:
            return y + increment
        return y + increment * _weight_of_prediction(self.z)

    def correct(self, y: Any, predicted: Any, change: Any) -> Any:
        if self.z is None:
            return predicted + 0.5 * change
        return predicted + _weight_of_correction(self.z) * (change + self.z * (predicted - y))


@jax.custom_jvp
def _weight_of_prediction(z: Any) -> Any:
    return (1 + 0.5 * z) / (1 + z * (1 + 0.5 * z))


@jax.custom_jvp
def _weight_of_correction(z: Any) -> Any:
    return (0.5 + 0.5 * z) / (1 + z * (1 + 0.5 * z))


@_weight_of_prediction.defjvp
def _of_prediction(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    (z,), (along,) = primals, tangents
    return _weight_of_prediction(z), -(0.5 + z * (1 + 0.25 * z)) / (1 + z * (1 + 0.5 * z)) ** 2 * along


@_weight_of_correction.defjvp
def _of_correction(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    (z,), (along,) = primals, tangents
    return _weight_of_correction(z), -0.5 * z * (1 + 0.5 * z) / (1 + z * (1 + 0.5 * z)) ** 2 * along
