"""Whether an actuator with these parameters can exist."""

import jax.numpy as jnp
import numpy as np

from .._errors import InputError, is_traced
from .._types import Values
from ..parts import AbstractChamber, Diaphragm
from ._base import AbstractModel
from ._instrumented import bare
from ._plant import AbstractPlant
from ._pneumatic import PneumaticActuator


def least_volume(model: AbstractModel) -> Values | None:
    """Volume in m3 that the gas of a model's chamber has when the vanes are closed, `V_0 - A_d x_max` [2.41].

    Infinite where the rod has no end stop; `None` for a model without a chamber.
    """
    parts = _chamber_and_diaphragm(model)
    if parts is None:
        return None
    chamber, diaphragm = parts
    stops = jnp.isfinite(diaphragm.travel)
    swept = diaphragm.displaced_volume(jnp.where(stops, diaphragm.travel, 0.0))
    return jnp.where(stops, chamber.volume - swept, jnp.inf)


def is_physical(model: AbstractModel) -> bool:
    """Whether the diaphragm leaves the chamber a volume all along the travel."""
    left = least_volume(model)
    return left is None or bool(np.all(np.asarray(left) > 0))


def require_physical(model: AbstractModel) -> None:
    """Refuses an actuator whose diaphragm would swallow its chamber; says nothing while it is traced.

    **Raises:** `InputError`.
    """
    parts = _chamber_and_diaphragm(model)
    if parts is None or is_traced(model) or is_physical(model):
        return
    chamber, diaphragm = parts
    volume, swept = chamber.volume, diaphragm.displaced_volume(diaphragm.travel)
    raise InputError(
        f"'chamber.volume' must be larger than what the diaphragm sweeps, diaphragm.area times diaphragm.travel "
        f"({float(swept):.4g} m3), but it is {float(volume):.4g} m3; enlarge it, or correct area or travel",
        "values",
    )


def _chamber_and_diaphragm(model: AbstractModel) -> tuple[AbstractChamber, Diaphragm] | None:
    """Those of a model, with its sensors or without; `None` where it has no chamber."""
    model = bare(model)
    # The pneumatic half has a diaphragm of its own.
    return (model.chamber, model.diaphragm) if isinstance(model, AbstractPlant | PneumaticActuator) else None
