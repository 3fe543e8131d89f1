"""The bench tests of chapters 2 and 3 one after the other, each on what the earlier ones found."""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp

from ..estimation import Evaluation, bundle_traces, compiling_ahead, observe
from ..parameters import parameter_table, replace_parameters
from ..parts import AbstractVaneMap, ForcePolynomial
from ..plants import AbstractModel, AbstractRodModel, Actuator, MechanicalActuator, Plant, as_actuator, assemble
from ..simulation import first_failure
from ..traces import Trace
from ._filters import has_gas
from ._result import Identified, NotPossible, Test, bench_test
from .mechanical import (
    foreseen_response,
    identify_axis,
    identify_dahl,
    identify_lugre,
    identify_mass_and_damping,
    identify_spring,
    identify_vane_map,
    identify_vane_polynomial,
    mechanical_fit,
)
from .pneumatic import foreseen_plunger, identify_flow_areas, identify_magnetic_force, identify_plunger

RodModel = TypeVar("RodModel", bound=AbstractRodModel)

SPRING = (identify_spring,)
PNEUMATIC = (identify_magnetic_force, identify_flow_areas, identify_plunger)
MECHANICAL = (identify_mass_and_damping, identify_dahl, identify_lugre, mechanical_fit)
FORESEEN: dict[Test, Callable[[Any, Sequence[Trace]], Iterator[list[Evaluation]]]] = {
    identify_plunger: foreseen_plunger,
    mechanical_fit: foreseen_response,
}
"""What fits will ask whose programs take seconds to compile: they are made beside the tests before them."""


@bench_test("pneumatic half", "2.58", "None.")
def own_air_path(model: Plant, traces: Sequence[Trace]) -> Identified:
    """Says that an air path of one's own has no bench test."""
    raise NotPossible(
        "the tests of magnetic force, orifices and plunger read an AirPath, and that of this plant is "
        f"{type(model.air_path).__name__}; fit its parameters to the traces instead"
    )


def plan(model: AbstractRodModel, traces: Sequence[Trace]) -> list[tuple[Test, list[Trace]]]:
    """The tests that make sense for a model, in an order in which each finds what it builds on, with their traces.

    Springs and friction are identified from traces without exhaust gas, where there are any. An axis that a force
    drives has a test of its own in place of those of the actuator.
    """
    everything = list(traces)
    driven = [trace for trace in traces if trace.f_drive is not None]
    if isinstance(model, MechanicalActuator) and driven:
        return [(identify_axis, driven)]
    quiet = [trace for trace in traces if not has_gas(trace)] or everything
    pneumatic = PNEUMATIC if as_actuator(model) else (own_air_path,) if isinstance(model, Plant) else ()
    tests: list[tuple[Test, list[Trace]]] = [(test, quiet) for test in SPRING]
    tests += [(test, everything) for test in pneumatic]
    tests += [(test, quiet) for test in MECHANICAL]
    if isinstance(model.vane_force, ForcePolynomial):
        tests.append((identify_vane_polynomial, everything))
    elif isinstance(model.vane_force, AbstractVaneMap) or any(map(has_gas, traces)):
        tests.append((identify_vane_map, everything))
    return tests


def identify(model: AbstractRodModel, traces: Sequence[Trace]) -> Iterator[tuple[AbstractRodModel, Identified]]:
    """Runs the tests that the traces allow, each on the model that the earlier ones left.

    Yields that model and what was found, one test at a time. A [`Plant`][] of the parts of an [`Actuator`][] is
    identified as one; an air path of another make has no test, which is said. A test whose values leave a model that
    can't be simulated along the traces any more, whatever their errors, changes nothing and says so.
    """
    given, model = model, as_actuator(model) or model
    tests = plan(model, traces)
    ahead = [FORESEEN[test](model, mine) for test, mine in tests if test in FORESEEN]
    with compiling_ahead(itertools.chain(*ahead)):
        for test, mine in tests:
            model, found = _tested(test, model, mine, traces)
            yield _as_given(given, model), found


def _tested(
    test: Test, model: AbstractRodModel, mine: Sequence[Trace], traces: Sequence[Trace]
) -> tuple[AbstractRodModel, Identified]:
    """The model with what a test found, if that can be simulated along all traces, and what it found."""
    found = test(model, mine)
    moved = apply(model, found)
    if found.values and not _simulates(moved, traces) and _simulates(model, traces):
        refused = "the traces can't be simulated with the values found, so the model keeps its own"
        limitations = (*found.limitations, refused)
        return model, dataclasses.replace(found, values={}, std_errors={}, limitations=limitations)
    return moved, found


def _as_given(given: AbstractRodModel, model: AbstractRodModel) -> AbstractRodModel:
    """What was identified as an [`Actuator`][], as the plant that was given."""
    if not isinstance(model, Actuator):
        return model
    return assemble(given, air_path=model.air_path, rod=model.rod, air=model.air)


def apply(model: RodModel, found: Identified) -> RodModel:
    """`model` with what a test found; tables take the knots that it chose."""
    knots = found.values.get("vane_force.turbine_pressure")
    if knots is not None:
        assert isinstance(model.vane_force, AbstractVaneMap)
        moved = model.vane_force.on_knots(jnp.asarray(knots), model.vane_force.crank_angle)
        model = eqx.tree_at(lambda m: m.vane_force, model, moved)
    known = parameter_table(model)
    return replace_parameters(model, {name: value for name, value in found.values.items() if name in known})


def _simulates(model: AbstractModel, traces: Sequence[Trace]) -> bool:
    needs = [need.split("|") for need in model.needs]
    driven = [t for t in traces if all(any(getattr(t, name) is not None for name in need) for need in needs)]
    ends = [observe(model, bundle)[1] for bundle in bundle_traces(model, driven)]
    return not any(map(first_failure, ends))
