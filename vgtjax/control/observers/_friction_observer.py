"""The dual friction observer: two bristles and three coefficients [5.47-5.48, 5.69 corrected]."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Scalar
from ...parameters import parameter
from .._design import AbstractDesign, Condition, positive
from .._design_model import DesignModel

Bristles = Float[Array, " 2"]
Coefficients = Float[Array, " 3"]


class FrictionEstimate(eqx.Module):
    """What the observer believes, or its rates per second."""

    deflections: Bristles
    """`zh0, zh1` in m."""
    coefficients: Coefficients
    """`bh0` in 1/s2, `bh1` in 1/s, `bh2` in N/(kg m s)."""


class DualFrictionObserver(AbstractDesign):
    """Friction over mass as `bh0 zh0 + bh1 v - bh2 h zh1`, `h = |v| / g(v)`, with all of it estimated but `sigma_0` and
    `g`.

    Each of the two products that hold the unknown deflection has a bristle of its own; `q` in m/s is the one signal
    that drives everything, with gains `gamma_i = Gamma beta_i^2`. A `bh_i` is held between `least` and `largest` times
    `beta_i`. The manual's page of derivations has the equations, and says why, and for which plants.

    **Raises:** `InputError` for a gain that is negative, or a start that is not between `least` and `largest`, which
    must be positive.
    """

    injection: Bristles = parameter(
        (0.026, 0.011), symbol="iota", unit=("1", "N s/m"), source="5.69, value assumed", lower=0.0
    )
    adaptation: Scalar = parameter(0.3, symbol="Gamma", unit="s2/m2", source="5.69, value assumed", lower=0.0)
    least: Scalar = parameter(0.5, symbol="beta_lo", unit="1", source="assumed", held=True)
    largest: Scalar = parameter(1.5, symbol="beta_hi", unit="1", source="assumed", held=True)
    start: Coefficients = parameter((1.0, 1.0, 1.0), symbol="bh_0", unit=("1", "1", "1"), source="assumed", held=True)
    """Of the coefficients that the design model has, as are `least` and `largest`."""

    def conditions(self) -> dict[str, Condition]:
        """A start inside the interval."""
        least, largest = (jnp.expand_dims(end, -1) for end in (self.least, self.largest))
        inside = Condition(
            jnp.minimum(self.start - least, largest - self.start),
            "start of the coefficients must lie between least and largest",
            self.start,
            "use e.g. 1, with 0.5 and 1.5",
            closed=True,
            bounds_gains=False,
        )
        return positive(self, "least") | {"start inside": inside}

    def initial_state(self, model: DesignModel) -> FrictionEstimate:
        """Relaxed bristles."""
        coefficients = self.start * nominal_coefficients(model)
        return FrictionEstimate(jnp.zeros_like(coefficients[:2]), coefficients)

    def rates(
        self, model: DesignModel, estimate: FrictionEstimate, velocity: Scalar, drive: Scalar
    ) -> FrictionEstimate:
        """Time derivatives; `drive` is `q` in m/s."""
        pulled = velocity + self._injected(model, velocity, drive)
        deflection_rates = pulled - model.relaxation_rate(velocity) * estimate.deflections
        return FrictionEstimate(deflection_rates, self._adapting(model, estimate, velocity, drive))

    def step(
        self, model: DesignModel, estimate: FrictionEstimate, velocity: Scalar, drive: Scalar, period: float
    ) -> FrictionEstimate:
        """One sample later."""
        pulled = velocity + self._injected(model, velocity, drive)
        deflections = model.friction.deflection_after(estimate.deflections, pulled, velocity, period)
        onward = estimate.coefficients + period * self._adapting(model, estimate, velocity, drive)
        nominal = nominal_coefficients(model)
        furthest = 2 * model.friction.static_force / model.friction.bristle_stiffness
        deflections = jnp.clip(deflections, -furthest, furthest)
        return FrictionEstimate(deflections, jnp.clip(onward, self.least * nominal, self.largest * nominal))

    def _injected(self, model: DesignModel, velocity: Scalar, drive: Scalar) -> Bristles:
        """`J0, J1` in m/s."""
        h = model.slide(velocity)
        return -self.injection * drive * jnp.stack([jnp.ones_like(h), -h])

    def _adapting(
        self, model: DesignModel, estimate: FrictionEstimate, velocity: Scalar, drive: Scalar
    ) -> Coefficients:
        gains = self.adaptation * nominal_coefficients(model) ** 2
        return -gains * drive * regressors(model, estimate.deflections, velocity)


def nominal_coefficients(model: DesignModel) -> Coefficients:
    """`beta0, beta1, beta2` of a design model, which a plant may have other ones of."""
    friction = model.friction
    forces = jnp.stack(
        [
            friction.bristle_stiffness,
            friction.bristle_damping + friction.viscous_damping,
            friction.bristle_stiffness * friction.bristle_damping,
        ]
    )
    return model.load * forces / model.diaphragm.mass


def regressors(model: DesignModel, deflections: Bristles, velocity: Scalar) -> Coefficients:
    """What the coefficients multiply: `zh0, v, -h zh1`."""
    return jnp.stack([deflections[0], velocity, -model.slide(velocity) * deflections[1]])
