"""Flow maps from the full model, with how good they are."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._errors import InputError
from ..._types import Scalar, Values
from ...parts import (
    FULL_DUTY,
    AbstractFlowMap,
    AbstractLiftMap,
    Air,
    Converter,
    LiftTable,
    PolynomialFlow,
    PrintedFlow,
    SteadyPlungerFlow,
)
from ...traces import ASSUMED_RESERVOIR
from .._actuator import Actuator, require_actuator
from .._base import AbstractModel
from ._polynomial_fit import fit_polynomial_flow

Grid = Float[np.ndarray, "..."]
FlowMap = AbstractFlowMap | AbstractLiftMap

DUTIES = 101
"""Duties of the grid, a percent apart."""
PRESSURES = 101
"""Pressures of the grid."""
NEAR = 2e4
"""Pa from equilibrium at which a sample counts half in the polynomial's fit. Of 4 to 50 kPa it gives the best steps."""
OPENING = 8
"""Knots of a table over the parabola of the atmosphere's orifice [B.3], in squared distances."""
CURVED = 5
"""Knots from the choked flow to equal pressures, in squared distances towards the latter, where the root is steep."""


@dataclasses.dataclass(frozen=True, eq=False)
class FlowMapFit:
    """A flow map, and how it meets what it was fitted to: the full model with a steady plunger, or measured flow.

    `rmse` and `peak` in kg/s; `pressure_rate_rmse` in Pa/s is what the former means for a full chamber, `R T / V_0`
    times as much; `r_squared` is one minus the share of the flow's variance that is left. `duty_range` in percent,
    `pressure_range` in Pa absolute, `reservoir` in Pa absolute.
    """

    flow_map: FlowMap
    r_squared: float
    rmse: float
    peak: float
    pressure_rate_rmse: float
    duty_range: tuple[float, float]
    pressure_range: tuple[float, float]
    reservoir: float


@dataclasses.dataclass(frozen=True, eq=False)
class _Samples:
    """The full model on a grid, its plunger at rest: flow in kg/s and plunger position in m."""

    model: Actuator
    reservoir: Scalar
    duty: Grid
    pressure: Grid
    position: Grid
    flow: Grid


def steady_flow(model: Actuator, duty: Values, pressure: Values, reservoir: Scalar) -> Grid:
    """Mass flow in kg/s into an isothermal chamber while the plunger rests where [2.7] balances.

    A line takes no part: in steady flow it passes what enters.

    **Arguments:** duty in percent and chamber pressure in Pa absolute, of one shape; reservoir in Pa absolute.
    """
    return _sample(model, duty, pressure, reservoir).flow


def _sample(model: Actuator, duty: Values, pressure: Values, reservoir: Scalar) -> _Samples:
    found = _at_rest(model, jnp.asarray(duty, float), jnp.asarray(pressure, float), jnp.asarray(reservoir))
    return _Samples(model, reservoir, *(np.asarray(values) for values in (duty, pressure, *found)))


@eqx.filter_jit
def _at_rest(model: Actuator, duty: Array, pressure: Array, reservoir: Array) -> tuple[Array, Array]:
    """Plunger position in m, and flow in kg/s."""
    lift = model.converter.rest_position(duty, model.air.pressure, reservoir, pressure)
    return lift, _flow_at(model, lift, pressure, reservoir)


@eqx.filter_jit
def _flow_at(model: Actuator, lift: Array, pressure: Array, reservoir: Array) -> Array:
    """Flow in kg/s into a chamber at ambient temperature."""
    air = model.air
    return model.converter.flow(air, lift, air.pressure, reservoir, pressure, air.temperature).mass_flow


@eqx.filter_jit
def _evaluate(flow_map: FlowMap, at: Array, pressure: Array) -> Array:
    return flow_map(at, pressure)


def fit_flow_map(
    model: AbstractModel,
    kind: str = "steady-plunger",
    *,
    reservoir: float = ASSUMED_RESERVOIR,
    pressure_range: tuple[float, float] | None = None,
) -> FlowMapFit:
    """A flow map of the full model at its present parameters, by steady flow on a grid of duty and pressure.

    **Arguments:**

    - `kind`: `"steady-plunger"` ([`SteadyPlungerFlow`][]), `"polynomial"` ([`PolynomialFlow`][], least squares whose
      slopes over duty and pressure may not rise), `"printed"` ([`PrintedFlow`][], of which only `p_eq` is the model's),
      all three over duty; `"lift-table"` ([`LiftTable`][]) over plunger position.
    - `reservoir`: pressure in Pa absolute, which a map holds fixed.
    - `pressure_range`: in Pa absolute, by default from the working pressure at full duty to the atmosphere.

    **Raises:** `InputError` for another kind or model, or pressures at which the converter does not work.
    """
    if kind not in FLOW_MAPS:
        raise InputError(f"kind must be one of {', '.join(FLOW_MAPS)}, but it is {kind!r}; choose one of these")
    full = require_actuator(model, "a flow map is fitted to")
    low, high = _pressures(full, reservoir, pressure_range)
    duty, pressure = np.meshgrid(np.linspace(0.0, FULL_DUTY, DUTIES), np.linspace(low, high, PRESSURES), indexing="ij")
    samples = _sample(full, duty, pressure, reservoir)
    flow_map = FLOW_MAPS[kind](samples)
    at = samples.position if isinstance(flow_map, AbstractLiftMap) else duty
    return assess_flow_map(full, flow_map, at, pressure, samples.flow, (0.0, FULL_DUTY), reservoir)


def _pressures(model: Actuator, reservoir: float, wanted: tuple[float, float] | None) -> tuple[float, float]:
    """The range of the grid in Pa absolute, checked."""
    ambient = float(model.air.pressure)
    if not 0 < reservoir < ambient:
        raise InputError(
            f"the reservoir's pressure must lie between zero and the atmosphere, {ambient:g} Pa, but it is "
            f"{reservoir:g}; give Pa absolute"
        )
    lowest = float(model.converter.working_pressure(jnp.asarray(FULL_DUTY), model.air.pressure, reservoir))
    if wanted is None:
        return lowest, ambient
    low, high = wanted
    # Air must flow both ways somewhere in it.
    if not (0 < low < high and low < ambient and high > lowest):
        raise InputError(
            f"pressure_range must rise from above zero, and overlap the working pressures from {lowest:.0f} to "
            f"{ambient:.0f} Pa, but it is ({low:g}, {high:g}); give Pa absolute"
        )
    return low, high


def assess_flow_map(
    model: Actuator,
    flow_map: FlowMap,
    at: Float[np.ndarray, "..."],
    pressure: Float[np.ndarray, "..."],
    flow: Float[np.ndarray, "..."],
    duty_range: tuple[float, float],
    reservoir: float,
) -> FlowMapFit:
    """How a map meets flows in kg/s at duties or positions `at` and pressures in Pa absolute, of one shape."""
    error = np.asarray(_evaluate(flow_map, jnp.asarray(at), jnp.asarray(pressure))) - flow
    rmse = float(np.sqrt(np.mean(error**2)))
    return FlowMapFit(
        flow_map,
        r_squared=1 - float(np.mean(error**2) / np.var(flow)),
        rmse=rmse,
        peak=float(np.max(np.abs(error))),
        pressure_rate_rmse=rmse * float(model.air.gas_constant * model.air.temperature / model.chamber.volume),
        duty_range=duty_range,
        pressure_range=(float(pressure.min()), float(pressure.max())),
        reservoir=reservoir,
    )


def _polynomial(samples: _Samples) -> PolynomialFlow:
    """[5.10], for which samples count the less the farther they are from equilibrium."""
    weight = 1 / (1 + (_lack(samples) / NEAR) ** 2)
    return fit_polynomial_flow(
        samples.duty.ravel(),
        samples.pressure.ravel(),
        samples.flow.ravel(),
        weight.ravel(),
        pressure_range=(float(samples.pressure.min()), float(samples.pressure.max())),
        ambient=float(samples.model.air.pressure),
    )


def _lack(samples: _Samples) -> Grid:
    """`p_eq(u) - p` in Pa."""
    return np.polynomial.Polynomial(_equilibrium(samples))(samples.duty) - samples.pressure


def _equilibrium(samples: _Samples) -> Float[np.ndarray, " 5"]:
    """`p_eq(u)` in Pa, where the plunger closes, as a quartic (exact for the static magnetic force)."""
    converter, ambient = samples.model.converter, samples.model.air.pressure
    duty = jnp.asarray(samples.duty[:, 0])
    pull = converter.magnetic_force.steady_pull(duty, jnp.zeros_like(duty))
    closed = converter.static_force(pull, ambient, samples.reservoir, jnp.zeros_like(duty)) / converter.actuator_area
    return np.polynomial.Polynomial.fit(samples.duty[:, 0], np.asarray(closed), 4).convert().coef


def _printed(samples: _Samples) -> PrintedFlow:
    return PrintedFlow(equilibrium=jnp.asarray(_equilibrium(samples)), ambient=samples.model.air.pressure)


def _table(samples: _Samples) -> LiftTable:
    """The flow at knots, rather than its least squares: so what is zero stays zero, and no slope changes its sign."""
    model, reservoir = samples.model, samples.reservoir
    position = lift_knots(model.converter, float(samples.position.min()), float(samples.position.max()))
    pressure = pressure_knots(model.air, reservoir)
    at, inside = (jnp.asarray(values) for values in np.meshgrid(position, pressure, indexing="ij"))
    flow = _flow_at(model, at, inside, jnp.asarray(reservoir))
    return LiftTable(
        position=jnp.asarray(position), pressure=jnp.asarray(pressure), flow=flow.ravel(), ambient=model.air.pressure
    )


def _steady_plunger(samples: _Samples) -> SteadyPlungerFlow:
    lack = _lack(samples)
    below = lack < 0
    compliance = [
        float(np.sum(samples.position[side] * lack[side]) / np.sum(lack[side] ** 2)) for side in (below, ~below)
    ]
    return SteadyPlungerFlow(  # type: ignore[call-arg]  # mypy takes the abstract `ambient` for a field
        equilibrium=jnp.asarray(_equilibrium(samples)), compliance=jnp.array(compliance), table=_table(samples)
    )


FLOW_MAPS: dict[str, Callable[[_Samples], FlowMap]] = {
    "steady-plunger": _steady_plunger,
    "polynomial": _polynomial,
    "printed": _printed,
    "lift-table": _table,
}
"""How each kind of map is made."""


def printed_flow_map(kind: str) -> FlowMap:
    """That of the printed actuator, which a reduced model has by default."""
    with jax.ensure_compile_time_eval():  # also where a model is made under jit
        return fit_flow_map(Actuator(), kind).flow_map


# A table of flow has knots at every kink of the flow, and denser ones where it bends.


def lift_knots(converter: Converter, lowest: float, highest: float) -> Float[np.ndarray, " positions"]:
    """Plunger positions in m between two ends: saturation, closed, the opened leak, and the parabola."""
    saturated = -float(converter.reservoir_orifice_saturation)
    leak = float(converter.opening_lift)
    above = max(highest, 2 * leak)
    rise = leak + (above - leak) * (np.arange(1, OPENING + 1) / OPENING) ** 2
    below = [min(lowest, 1.001 * saturated), saturated]
    return np.unique(np.concatenate([below, [0.0, leak], rise]))


def pressure_knots(air: Air, reservoir: float) -> Float[np.ndarray, " pressures"]:
    """Pressures in Pa from half the reservoir's to a twentieth above the atmosphere's.

    Below the reservoir's and above the atmosphere's, flow goes the other way.
    """
    ambient, critical = float(air.pressure), float(air.critical_ratio())
    towards = np.linspace(0.0, 1.0, CURVED + 1) ** 2
    evacuated = reservoir + (reservoir / critical - reservoir) * towards
    vented = ambient - ambient * (1 - critical) * towards
    return np.unique(np.concatenate([[0.5 * reservoir], evacuated, vented, [1.05 * ambient]]))
