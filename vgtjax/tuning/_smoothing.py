"""What is made smoother while gains are tuned, so that derivatives say where the cost falls."""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..control import AdaptiveBackstepping, Knocker, LevantDifferentiator, Scenario, Sensor
from ..parameters import get_parameter, replace_parameters
from ..parts import without_chatter
from ._cases import Cases
from ._parts import parts


def soften(module: Any) -> Any:
    """A controller or a plant with its switching laws widened to what [`widths_of`][] says, none made narrower."""
    for name, width in wanted_widths(module).items():
        module = replace_parameters(module, {name: jnp.maximum(get_parameter(module, name), width)})
    return without_chatter(module)


def soften_cases(cases: Cases) -> Cases:
    """Closed loops whose plants do not chatter, and whose sensors have noise but no steps."""
    scenarios = eqx.tree_at(
        lambda s: [sensor.quantum for sensor in _sensors(s)], cases.scenarios, replace_fn=jnp.zeros_like
    )
    return dataclasses.replace(cases, plants=without_chatter(cases.plants), scenarios=scenarios)


def _sensors(scenario: Scenario) -> list[Sensor]:
    values = [getattr(scenario.sensors, field.name) for field in dataclasses.fields(scenario.sensors)]
    return [value for value in values if isinstance(value, Sensor)]


def wanted_widths(module: eqx.Module) -> dict[str, float]:
    """Least width of each switching law while tuning, by parameter name."""
    return {prefix + name: width for prefix, part in parts(module) for name, width in widths_of(part).items()}


@functools.singledispatch
def widths_of(part: eqx.Module) -> dict[str, float]:
    """Least widths of one part alone; register those of a design of your own."""
    return {}


@widths_of.register
def _(part: LevantDifferentiator) -> dict[str, float]:
    """Above the noise of the bench, so that its sign is not tossed by it."""
    return {"width": 3e-5}


@widths_of.register
def _(part: AdaptiveBackstepping) -> dict[str, float]:
    """A velocity that the noise of the bench reaches through the differentiator."""
    return {"reversal_width": 2e-3}


@widths_of.register
def _(part: Knocker) -> dict[str, float]:
    """In percent; a tenth of a usual pulse."""
    return {"sign_width": 0.2}
