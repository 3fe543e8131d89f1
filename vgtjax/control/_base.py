"""What every controller of the position has in common: what it is given, and what it answers [chapter 5]."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from .._types import OwnState, Scalar, Values
from ..parts import FULL_DUTY
from ..plants import AbstractPlant
from ._design import AbstractDesign

Memory = PyTree[Array]
Log = dict[str, Values]

JUDGED = frozenset({"pressure", "velocity_error"})
"""What a controller may observe that its closed loops are judged by, as it is called in a log."""


class Measurement(eqx.Module):
    """What a controller measures at one sample, or at all samples of a run (leading axis)."""

    position: Values
    """Position of the rod in m."""
    pressure: Values
    """Chamber pressure in Pa absolute."""
    reservoir: Values
    """Reservoir pressure in Pa absolute."""
    ambient: Values
    """Atmospheric pressure in Pa."""
    turbine: Values = eqx.field(default_factory=lambda: jnp.zeros(()))
    """Pressure at the turbine's inlet in Pa gauge."""


class Reference(eqx.Module):
    """Where the rod should be at one sample, or at all samples of a run (leading axis)."""

    position: Values
    """m"""
    velocity: Values
    """m/s"""
    acceleration: Values
    """m/s2"""
    jerk: Values
    """m/s3"""


class AbstractController(AbstractDesign):
    """A sampled control law. Its gains are its array leaves, declared with [`parameter`][].

    A controller of your own has a law, `initial_state` and `update`; where there is a proof, its `conditions`; and
    where its gains or beliefs depend on the plant, `for_plant`. Nothing has to be registered anywhere.

    It is shown numbers only: in a closed loop, and in C, the last number that a channel has shown stands for what is
    none, of a sensor that is lost for instance. How long that is good is not its business; [`WithFallback`][] asks.

    What it remembers from one sample to the next is a PyTree of arrays that it alone understands, of the same
    shapes and types at every sample.
    """

    sampled: ClassVar[bool] = False
    """Whether `for_plant` designs it for samples of one period, and takes a `period` in s."""

    @property
    def observes(self) -> frozenset[str]:
        """What it logs of the plant as it sees it, by which its closed loops are judged: `pressure`, the chamber's in
        Pa absolute, and `velocity_error` in m/s, by how much the velocity of an observer that switches is off.

        Here nothing. A controller around another one observes what that does.
        """
        return frozenset()

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "AbstractController":
        """The design for a plant: its beliefs are that plant, its gains scaled to it; `settings` are fields as given.

        Here it believes nothing, and has its default gains.

        **Raises:** `InputError` for a plant that lacks what the design observes.
        """
        return cls(**settings)

    @property
    def sees_gaps(self) -> bool:
        """Whether it is shown what is no number as well, and bears it."""
        return False

    @abc.abstractmethod
    def initial_state(self, measurement: Measurement) -> Memory:
        """What it remembers before the first sample, whose measurement is given."""

    @abc.abstractmethod
    def update(
        self, state: OwnState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[Memory, Scalar, Log]:
        """One sample, `period` s before the next: what it remembers then, the duty in percent before saturation, and
        scalars to be logged."""


def room(duty: Scalar, enough: float) -> Scalar:
    """From 1, where the duty in percent is `enough` percent off its limits or more, to 0 at them."""
    return jnp.clip(jnp.minimum(duty, FULL_DUTY - duty) / enough, 0.0, 1.0)


def saturate(duty: Scalar) -> Scalar:
    """The duty in percent that the converter can get: within 0 and 100."""
    return jnp.clip(duty, 0.0, FULL_DUTY)
