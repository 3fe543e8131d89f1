"""Controllers by the names that a study gives them, with a nominal actuator as their belief about the plant."""

from collections.abc import Callable
from typing import cast

import jax.numpy as jnp
from jaxtyping import Array

import vgtjax
from vgtjax import InputError
from vgtjax.control import (
    PI,
    PID,
    AbstractController,
    AdaptiveBackstepping,
    Backstepping,
    DesignModel,
    FrictionCompensation,
    Knocker,
    PressureObserver,
    StaticBalance,
)

HALVINGS = 8


def build_controller(design: str, nominal: vgtjax.Actuator) -> AbstractController:
    """A design with its default gains.

    **Raises:** `InputError` for a design that needs LuGre friction where the nominal actuator has none.
    """
    if design in _NEED_LUGRE and not isinstance(nominal.friction, vgtjax.LuGre):
        raise InputError(
            f"design = '{design}' observes the bristles of LuGre friction, but the study's friction is "
            f"{type(nominal.friction).__name__}; use friction = 'lugre', or design = 'pi'"
        )
    return DESIGNS[design](nominal)


def _pi(nominal: vgtjax.Actuator) -> PI:
    return PI(base=StaticBalance(nominal.converter, nominal.diaphragm))


def _friction_compensation(nominal: vgtjax.Actuator) -> FrictionCompensation:
    """With the default damping, or with half as much again as [5.9] asks for."""
    body, friction = nominal.diaphragm, cast(vgtjax.LuGre, nominal.friction)
    bound = friction.bristle_stiffness * body.mass / friction.bristle_damping - body.damping
    default = FrictionCompensation().derivative_gain
    return FrictionCompensation(
        derivative_gain=jnp.maximum(default, 1.5 * bound),
        converter=nominal.converter,
        diaphragm=body,
        friction=friction,
    )


def _observer(model: DesignModel) -> PressureObserver:
    """With the default rates, that of friction halved until [5.21] holds for the nominal actuator."""
    rate = PressureObserver().friction_rate
    for _ in range(HALVINGS):
        try:
            return PressureObserver(model, friction_rate=rate)
        except InputError:
            rate = rate / 2
    return PressureObserver(model, friction_rate=rate)


def _design_model(nominal: vgtjax.Actuator) -> DesignModel:
    return DesignModel.of(nominal, vgtjax.fit_flow_map(nominal, "steady-plunger").flow_map)


def _backstepping(nominal: vgtjax.Actuator) -> Backstepping:
    model = _design_model(nominal)
    return Backstepping(observer=_observer(model), **_for_mass(Backstepping(), "velocity_gain", model))


def _adaptive(nominal: vgtjax.Actuator) -> AdaptiveBackstepping:
    model = _design_model(nominal)
    return AdaptiveBackstepping(model=model, **_for_mass(AdaptiveBackstepping(), "load_gain", model))


def _for_mass(default: AbstractController, gain: str, model: DesignModel) -> dict[str, Array]:
    """One default gain and the weight of pressure for a design model of another mass.

    The mass is a gain of both loops: the defaults are those of the printed one, and keep their forces like this.
    """
    lighter = DesignModel().diaphragm.mass / model.diaphragm.mass
    return {name: lighter * vgtjax.get_parameter(default, name) for name in (gain, "pressure_weight")}


DESIGNS: dict[str, Callable[[vgtjax.Actuator], AbstractController]] = {
    "pi": _pi,
    "pid": lambda nominal: PID(_pi(nominal)),
    "pi-knocker": lambda nominal: Knocker(_pi(nominal)),
    "friction-compensation": _friction_compensation,
    "backstepping": _backstepping,
    "adaptive-backstepping": _adaptive,
}
_NEED_LUGRE = ("friction-compensation", "backstepping", "adaptive-backstepping")
