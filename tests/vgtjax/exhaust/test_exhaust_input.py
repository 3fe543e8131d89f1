"""Engines and operating points that can't be are refused in one sentence; cycles that are not found fail in one."""

import re

import jax
import pytest
from support import quick_nozzle

from vgtjax import InputError, SimulationError, Turbine, parameter_table
from vgtjax.exhaust import Engine, OperatingPoint, Valve, pulsation, steady_cycle
from vgtjax.simulation import RESULTS

POINT = {
    "engine_speed": 1000.0,
    "trapped_mass": 0.476e-3,
    "opening_temperature": 1150.0,
    "outlet_pressure": 1.03e5,
    "effective_area": 87e-6,
}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"engine_speed": 0.0}, "engine_speed must be a positive speed in rpm, but it is 0.0; correct engine_speed"),
        (
            {"trapped_mass": -1.0},
            "trapped_mass must be a positive mass in kg, but it is -1.0; correct trapped_mass",
        ),
        (
            {"opening_temperature": float("nan")},
            "opening_temperature must be a positive temperature in K, but it is nan; correct opening_temperature",
        ),
        (
            {"outlet_pressure": 0.0},
            "outlet_pressure must be a positive pressure in Pa absolute, but it is 0.0; correct outlet_pressure",
        ),
        (
            {"effective_area": -1e-6},
            "effective_area must be a positive area in m2, but it is -1e-06; correct effective_area",
        ),
        (
            {"effective_area": None},
            "a manifold must empty through either an effective_area or a turbine, but there is neither; give exactly "
            "one",
        ),
        (
            {"turbine": object(), "crank_angle": 6.7},
            "a manifold must empty through either an effective_area or a turbine, but there is both; give exactly one",
        ),
        (
            {"crank_angle": 6.7},
            "a turbine and the crank_angle of its vanes belong together, but only the angle is given; give both or "
            "none",
        ),
        (
            {"effective_area": None, "turbine": object(), "crank_angle": 6.7},
            "a turbine must have mass_flow(total_pressure, crank_angle), total_temperature and outlet_pressure, but "
            "object has not; give e.g. a vane force of a turbine",
        ),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_a_bad_operating_point_is_refused(change, sentence):
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        OperatingPoint(**POINT | change)


def test_two_pressures_behind_one_turbine_are_refused():
    with quick_nozzle():
        turbine = Turbine(outlet_pressure=1.2e5)
    sentence = (
        "the pressure behind the turbine must be the 120000 Pa of its flow, but outlet_pressure is 103000 Pa; give "
        "one of them to both"
    )
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        OperatingPoint(**POINT | {"effective_area": None, "turbine": turbine, "crank_angle": 6.7})


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (
            lambda: Engine(manifold_volume=0.0),
            "engine.manifold_volume must be a positive volume in m3, but it is 0.0; correct it",
        ),
        (
            lambda: Engine(rod=0.04),
            "a connecting rod must be longer than the crank radius, but it is 0.04 m against 0.0455 m; correct "
            "engine.rod",
        ),
        (
            lambda: Engine(bore=-0.075),
            "engine.bore must be a positive number of metres, but it is -0.075; correct it",
        ),
        (
            lambda: Engine(firing_order=(1, 3, 3, 2)),
            "a firing order must name each cylinder once, from 1, but it is (1, 3, 3, 2); write e.g. (1, 3, 4, 2)",
        ),
        (
            lambda: Valve(closing=100.0),
            "an exhaust valve must open before it closes, but it opens at 140 deg and closes at 100 deg; correct "
            "valve.opening or valve.closing",
        ),
        (
            lambda: Valve(closing=730.0),
            "an exhaust valve must close before the next firing, but it does so at 730 deg after the last; correct "
            "valve.closing",
        ),
        (lambda: Valve(number=0), "a cylinder must have an exhaust valve, but it has 0; give e.g. 2"),
        (
            lambda: pulsation(Engine(firing_order=tuple(range(1, 8))), OperatingPoint(**POINT)),
            "cylinders must fire every so many times 0.5 deg, but 7 of them do so every 102.857 deg; choose another "
            "firing_order",
        ),
        (
            lambda: pulsation(Engine(), OperatingPoint(**POINT), substeps=0),
            "0.5 deg must have one step or more, but 0 are asked for; use e.g. 4",
        ),
    ],
    ids=["manifold", "rod", "bore", "order", "shut", "late", "none", "seven", "substeps"],
)
def test_a_bad_engine_is_refused(build, sentence):
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        build()


def test_a_cycle_that_is_not_found_fails():
    nearly_shut = OperatingPoint(**POINT | {"effective_area": 1e-6})
    with pytest.raises(SimulationError, match=r"^the cycle of the engine failed: No cycle repeats itself: check"):
        pulsation(Engine(), nearly_shut)
    assert steady_cycle(Engine(), nearly_shut)[1] == RESULTS.not_periodic


def test_a_cycle_that_is_not_found_fails_inside_of_jit():
    with pytest.raises(RuntimeError, match="No cycle repeats itself"):
        jax.block_until_ready(jax.jit(pulsation)(Engine(), OperatingPoint(**POINT | {"effective_area": 1e-6})))


def test_what_is_assumed_of_the_engine_is_marked_so():
    table = parameter_table(Engine())
    printed = {name for name, row in table.items() if not row.assumed}
    assert printed == {"bore", "crank_radius", "rod", "manifold_volume"}
    assert "- `manifold_volume`: V_x in m3, 0.00092 [B.2.1]" in Engine.__doc__
