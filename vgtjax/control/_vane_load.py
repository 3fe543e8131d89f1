"""The force of the exhaust gas on the vanes, as far as a controller knows it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..parts import AbstractVaneForce, Diaphragm, Scalar, Vanes


class Motion(eqx.Module):
    """Position in m and velocity in m/s of the rod as they are known, atmosphere in Pa, turbine inlet in Pa gauge."""

    position: Scalar
    velocity: Scalar
    ambient: Scalar
    turbine: Scalar = eqx.field(default_factory=lambda: jnp.zeros(()))


class VaneLoad(eqx.Module):
    """The model's vane force along a known motion. What it remembers is followed from sample to sample."""

    vane_force: AbstractVaneForce
    diaphragm: Diaphragm

    def __call__(self, motion: Motion, state: Any) -> Scalar:
        """Force in N along -x."""
        return self._force(motion, state)[0]

    def rate(self, motion: Motion, state: Any) -> Scalar:
        """Its time derivative in N/s, at a constant turbine pressure and velocity."""

        def force(position: Scalar, state: Any) -> Scalar:
            return self(Motion(position, motion.velocity, motion.ambient, motion.turbine), state)

        along = (motion.velocity, self.state_rate(motion, state))
        return jax.jvp(force, (motion.position, state), along)[1]

    def state_rate(self, motion: Motion, state: Any) -> PyTree[Scalar]:
        """Of what the force remembers, a second."""
        return self._force(motion, state)[1]

    def after(self, motion: Motion, state: Any, period: float) -> PyTree[Scalar]:
        """What it remembers a period in s later, by one step of implicit Euler."""
        forgetting = self.vane_force.relaxation(self._vanes(motion), motion.velocity, state)
        rates = self.state_rate(motion, state)
        return jax.tree.map(lambda s, rate, fade: s + period * rate / (1 + period * fade), state, rates, forgetting)

    def _force(self, motion: Motion, state: Any) -> tuple[Scalar, PyTree[Scalar]]:
        return self.vane_force(self._vanes(motion), motion.velocity, state)

    def _vanes(self, motion: Motion) -> Vanes:
        return Vanes(self.diaphragm.travel - motion.position, motion.turbine)
