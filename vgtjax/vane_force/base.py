"""What every model of the exhaust gas force on the vanes answers."""

import abc

import equinox as eqx

from ..air import Scalar


class AbstractVaneForce(eqx.Module):
    """Force of the exhaust gas on the rod, positive against +x."""

    @abc.abstractmethod
    def __call__(self, position: Scalar, velocity: Scalar, turbine_pressure: Scalar) -> Scalar:
        """Force in N at a rod position in m, velocity in m/s and turbine inlet pressure in Pa gauge."""
