"""Many closed loops side by side: plants, references and turbine pressures crossed."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._types import Scalar, Tree
from ..control import (
    AbstractDisturbance,
    AbstractSignal,
    Constant,
    Measurement,
    Reference,
    Scenario,
    Sensors,
    at_rest,
    balanced_at,
    holding_duty,
    reference_at,
)
from ..parts import Converter
from ..plants import AbstractModel, AbstractRodModel, require_converter
from ..traces import ASSUMED_RESERVOIR


class Case(eqx.Module):
    """Names of one closed loop; the turbine pressure in Pa gauge. A `variant` has other sensors and disturbances."""

    plant: str = eqx.field(static=True)
    reference: str = eqx.field(static=True)
    turbine_pressure: float = eqx.field(static=True)
    variant: str = eqx.field(static=True, default="")

    @property
    def course(self) -> str:
        """The reference, and the variant if it has a name."""
        return f"{self.reference}, {self.variant}" if self.variant else self.reference

    def __str__(self) -> str:
        said = f"{self.plant}, {self.reference}, {self.turbine_pressure / 100:g} mbar"
        return f"{said}, {self.variant}" if self.variant else said


class Variant(eqx.Module):
    """What a closed loop is put through beside its reference and its gas; all variants of one structure."""

    sensors: Sensors = eqx.field(default_factory=Sensors.bench)
    disturbances: tuple[AbstractDisturbance, ...] = ()


class Cases(eqx.Module):
    """Closed loops that are judged together. Arrays of `plants` and `scenarios` have a leading axis of cases."""

    labels: tuple[Case, ...] = eqx.field(static=True)
    plants: AbstractModel
    scenarios: Scenario
    duration: float = eqx.field(static=True)
    period: float = eqx.field(static=True)

    def __len__(self) -> int:
        return len(self.labels)

    def require_longer(self, settled: float) -> None:
        """**Raises:** `InputError` where runs are over before they count, from `settled` seconds on."""
        if not 0 <= settled < self.duration:
            raise InputError(
                f"settled must be zero or more and before the end of runs after {self.duration:g} s, but it is "
                f"{settled:g} s; correct it"
            )

    def take(self, indices: Sequence[int]) -> "Cases":
        """Some of the cases."""
        chosen = np.asarray(indices)
        plants, scenarios = jax.tree.map(lambda leaf: leaf[chosen], (self.plants, self.scenarios))
        return Cases(tuple(self.labels[i] for i in indices), plants, scenarios, self.duration, self.period)


def cross_cases(
    plants: Mapping[str, AbstractModel],
    references: Mapping[str, AbstractSignal],
    turbine_pressures: Sequence[float] = (0.0,),
    *,
    duration: float,
    period: float = 1e-3,
    sensors: Sensors | None = None,
    seed: int = 0,
    reservoir: AbstractSignal | None = None,
    disturbances: Sequence[AbstractDisturbance] = (),
    variants: Mapping[str, Variant] | None = None,
) -> Cases:
    """Every plant with every reference at every turbine pressure, in every variant.

    A run begins at rest where the reference does: in balance there, or with the chamber at atmosphere where the
    reference begins at zero. Every case has noise of its own.

    **Arguments:**

    - `plants`: by name; models of one structure that are driven by the duty.
    - `references`: by name, in m.
    - `turbine_pressures`: Pa gauge.
    - `duration`, `period`: of every run and of the controller's samples, s.
    - `sensors`: [`Sensors.bench`][] by default.
    - `reservoir`: in Pa absolute; by default what is assumed of one that nobody measured.
    - `disturbances`: of every case.
    - `variants`: by name, in place of `sensors` and `disturbances`; e.g. two with a [`LateDuty`][], of 0 s and of 4 ms.

    **Raises:** `InputError` where nothing is to be crossed, plants or variants differ in structure, or a plant without
    a converter is to begin off its stop.
    """
    if not plants or not references or not turbine_pressures:
        raise InputError("cases need at least one plant, one reference and one turbine pressure; give each")
    time = jnp.arange(round(duration / period) + 1) * period
    sensors = Sensors.bench() if sensors is None else sensors
    variants = {"": Variant(sensors, tuple(disturbances))} if variants is None else variants
    vacuum = Constant(ASSUMED_RESERVOIR) if reservoir is None else reservoir
    prepared = {name: _sample(signal, time) for name, signal in references.items()}
    crossed = list(itertools.product(plants, references, turbine_pressures, variants))
    keys = jax.random.split(jax.random.key(seed), len(crossed))
    labels, models, scenarios = [], [], []
    for (plant, reference, pressure, variant), key in zip(crossed, keys, strict=True):
        begin = float(prepared[reference].position[0])
        labels.append(Case(plant, reference, float(pressure), variant))
        models.append(plants[plant])
        scenarios.append(
            Scenario(
                prepared[reference],
                turbine=Constant(pressure),
                reservoir=vacuum,
                sensors=variants[variant].sensors,
                start=balanced_at(begin) if begin > 0 else at_rest(),
                duty_before=_duty_before(plants[plant], begin, vacuum(jnp.zeros(()))),
                key=key,
                disturbances=variants[variant].disturbances,
            )
        )
    return Cases(tuple(labels), stack_trees(models), stack_trees(scenarios, "variants"), float(duration), float(period))


@eqx.filter_jit
def _sample(signal: AbstractSignal, time: Float[Array, " time"]) -> Reference:
    return jax.vmap(lambda t: reference_at(signal, t))(time)


def _duty_before(plant: AbstractModel, position: float, reservoir: Scalar) -> Scalar:
    """Duty in percent that holds a plant at a position in m, without friction and gas; none of one that begins at its
    stop."""
    if position <= 0:
        return 0.0
    if not isinstance(plant, AbstractRodModel):
        raise InputError(f"a reference needs a rod, but {type(plant).__name__} has none; use e.g. Actuator")
    return _duty_at(plant, require_converter(plant, "a reference that begins off its stop"), position, reservoir)


@eqx.filter_jit
def _duty_at(plant: AbstractRodModel, converter: Converter, position: float, reservoir: Scalar) -> Scalar:
    ambient = plant.air.pressure
    pressure = plant.diaphragm.balance_pressure(ambient, position)
    return holding_duty(converter, Measurement(jnp.asarray(position), pressure, reservoir, ambient), pressure)


def stack_trees(trees: Sequence[Tree], what: str = "plants") -> Tree:
    """Trees side by side; all that is no array must be equal."""
    if len({jax.tree.structure(tree) for tree in trees}) > 1:
        raise InputError(f"{what} must be models of one structure, but their components or settings differ; align them")
    try:
        return jax.tree.map(lambda *leaves: _side_by_side(leaves), *trees)
    except ValueError as error:
        raise InputError(f"{what} must have tables of one size, but theirs differ; put them on common knots") from error


def _side_by_side(leaves: Sequence[Any]) -> Any:
    """On the host, where nothing is compiled for it; keys of random numbers have no place there."""
    if jnp.issubdtype(leaves[0].dtype, jax.dtypes.prng_key):
        return jnp.stack(leaves)
    return np.stack([np.asarray(leaf) for leaf in leaves])
