"""Whether an actuator with these parameters can exist."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .._errors import InputError, is_traced
from .._types import Values
from ._air_path import AbstractAirPathModel
from ._base import AbstractModel
from ._plant import AbstractPlant


def least_volume(model: AbstractModel) -> Values | None:
    """Volume in m3 that the gas of a model's chamber has when the vanes are closed, `V_0 - A_d x_max` [2.41].

    Infinite where the rod has no end stop; `None` for a model without a chamber.
    """
    # The pneumatic half has a diaphragm of its own.
    if not isinstance(model, AbstractPlant | AbstractAirPathModel):
        return None
    part: Any = model
    swept = part.diaphragm.displaced_volume(jnp.where(jnp.isfinite(part.diaphragm.travel), part.diaphragm.travel, 0.0))
    return jnp.where(jnp.isfinite(part.diaphragm.travel), part.chamber.volume - swept, jnp.inf)


def is_physical(model: AbstractModel) -> bool:
    """Whether the diaphragm leaves the chamber a volume all along the travel."""
    left = least_volume(model)
    return left is None or bool(np.all(np.asarray(left) > 0))


def require_physical(model: AbstractModel) -> None:
    """Refuses an actuator whose diaphragm would swallow its chamber; says nothing while it is traced.

    **Raises:** `InputError`.
    """
    if is_traced(model) or is_physical(model):
        return
    part: Any = model
    volume, swept = part.chamber.volume, part.diaphragm.displaced_volume(part.diaphragm.travel)
    raise InputError(
        f"'chamber.volume' must be larger than what the diaphragm sweeps, diaphragm.area times diaphragm.travel "
        f"({float(swept):.4g} m3), but it is {float(volume):.4g} m3; enlarge it, or correct area or travel",
        "values",
    )
