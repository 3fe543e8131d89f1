"""What is made smoother while gains are tuned, so that derivatives say where the cost falls."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from .._types import Module
from ..control import Scenario, Sensor
from ..parameters import get_parameter, parameter_table, replace_parameters
from ..parts import without_chatter
from ._cases import Cases


def soften(module: Module) -> Module:
    """A controller or a plant with its switching laws widened to their `tuning_width`, none made narrower."""
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
    return {name: row.tuning_width for name, row in parameter_table(module).items() if row.tuning_width > 0}
