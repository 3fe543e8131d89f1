"""A plain mode to fall back to where a controller can't be trusted with what it measures."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from ..._types import Scalar, Tree
from ...parameters import parameter
from ...plants import AbstractPlant
from .._base import AbstractController, Log, Measurement, Memory, Reference
from .._held import nominal, numbers
from ..surroundings import Sensor
from ._backstepping import Backstepping
from ._balance import StaticBalance


class FallbackState(eqx.Module):
    """What both controllers remember, the last measurement that was good, and for how many seconds the sensor of the
    position has shown the same value."""

    controller: Memory
    fallback: Memory
    good: Measurement
    unchanged: Scalar


class WithFallback(AbstractController):
    """Any controller, and another in its place while the position is not to be believed.

    It is believed if it is a number between `lowest` and `highest` that has changed within `patience`: noise moves
    what a sensor shows, so that one which stands still is stuck. Of a sensor without noise, or with coarser steps, that
    is not true: give it infinity, as `patience_with` does. While the position is not believed, the controller stands
    still and what it remembers is kept. The fallback must not need the position: [`StaticBalance`][] does not, by
    default.

    Neither is ever given what is no number: the last good value stands for it. A controller that none the less answers
    no number forgets what it remembers, and the fallback, or a closed valve, answers for it.
    """

    controller: AbstractController
    fallback: AbstractController = eqx.field(default_factory=StaticBalance)
    lowest: Scalar = parameter(-5e-4, symbol="x_lo", unit="m", source="assumed", positive=False, held=True)
    highest: Scalar = parameter(
        math.inf, symbol="x_hi", unit="m", source="assumed", positive=False, held=True, infinite=True
    )
    patience: Scalar = parameter(0.05, symbol="t_p", unit="s", source="assumed", held=True, infinite=True)

    @classmethod
    def for_plant(cls, plant: AbstractPlant, **settings: Any) -> "WithFallback":
        """Around [`Backstepping`][] for the plant unless another is given; good is up to 0.5 mm beyond its stops."""
        if "controller" not in settings:
            settings["controller"] = Backstepping.for_plant(plant)
        believed = {"fallback": StaticBalance.for_plant(plant), "highest": plant.diaphragm.travel - cls.lowest}
        return cls(**believed | settings)

    @classmethod
    def patience_with(cls, sensor: Sensor) -> float:
        """The default patience in s with a sensor whose noise can be seen, and infinity where its steps hide that."""
        return float(cls.patience) if bool(sensor.noise > sensor.quantum) else math.inf

    @property
    def sees_gaps(self) -> bool:
        """It is by what is no number that it knows a sensor that is lost."""
        return True

    @property
    def observes(self) -> frozenset[str]:
        """See the base class."""
        return self.controller.observes

    def initial_state(self, measurement: Measurement) -> FallbackState:
        """As if all had been good."""
        good = numbers(measurement, nominal(measurement))
        first = self.controller.initial_state(good)
        return FallbackState(first, self.fallback.initial_state(good), good, jnp.zeros_like(good.position))

    def update(
        self, state: FallbackState, measurement: Measurement, reference: Reference, period: float
    ) -> tuple[FallbackState, Scalar, Log]:
        """See the base class; logs what the controller does, and whether the `fallback` answered, 0 or 1."""
        unchanged = jnp.where(measurement.position == state.good.position, state.unchanged + period, 0.0)
        good = numbers(measurement, state.good)
        # Sums of the period miss a time by rounding, never by half a period.
        believed = self._believed(measurement.position, unchanged - 0.5 * period)
        good = dataclasses.replace(good, position=jnp.where(believed, good.position, state.good.position))
        fallback, plain, _ = self.fallback.update(state.fallback, good, reference, period)
        plain = jnp.where(jnp.isfinite(plain), plain, 0.0)
        onward, command, log = self.controller.update(state.controller, good, reference, period)
        sound = jnp.isfinite(command) & _finite(onward)
        fresh = self.controller.initial_state(good)
        kept = _choose(believed, _choose(sound, onward, fresh), state.controller)
        trusted = believed & sound
        log = {**_choose(sound, log, jax.tree.map(jnp.zeros_like, log)), "fallback": jnp.where(trusted, 0.0, 1.0)}
        return FallbackState(kept, fallback, good, unchanged), jnp.where(trusted, command, plain), log

    def _believed(self, position: Scalar, unchanged: Scalar) -> Bool[Array, ""]:
        inside = (position >= self.lowest) & (position <= self.highest)  # neither holds of what is no number
        return inside & (unchanged <= self.patience)


def _finite(tree: PyTree) -> Bool[Array, ""]:
    leaves = [jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)]
    return jnp.all(jnp.stack(leaves)) if leaves else jnp.asarray(True)


def _choose(condition: Bool[Array, ""], one: Tree, other: Tree) -> Tree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), one, other)
