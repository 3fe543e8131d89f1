"""Names, patterns, what is held, and the coordinates in which a fit moves."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import AdaptiveBackstepping, ImplicitLevantDifferentiator, LevantDifferentiator, ScheduledPI
from vgtjax.exhaust import ExhaustGas
from vgtjax.parameters import Part, Transform, build_transform, match_entries, table_row

HELD = {
    *(f"air.{name}" for name in ("gas_constant", "heat_capacity_ratio", "pressure", "temperature")),
    *(f"converter.{name}" for name in ("plunger_mass", "actuator_area", "atmosphere_area", "reservoir_area")),
    "diaphragm.area",
    "diaphragm.damping",
}
"""What the study format holds by default."""


def parts(kind: type) -> list[type]:
    """All that is derived from a class, of this package."""
    derived = [each for child in kind.__subclasses__() for each in (child, *parts(child))]
    return [each for each in derived if each.__module__.startswith("vgtjax.")]


@pytest.fixture
def table(actuator) -> dict[str, vgtjax.Parameter]:
    return vgtjax.parameter_table(actuator)


def test_names_are_paths_of_attributes(actuator, table):
    for name in table:
        value = actuator
        for part in name.split("."):
            value = getattr(value, part)
        if name == "converter.magnetic_force":  # a component whose only parameter has its name
            value = value.coefficients
        assert vgtjax.get_parameter(actuator, name) is value


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: vgtjax.Diaphragm(stiffness=-1), "'diaphragm.stiffness' must be finite and not negative, but it is -1"),
        (
            lambda: vgtjax.Air(heat_capacity_ratio=1.0),
            "'air.heat_capacity_ratio' must be finite and above 1, but it is",
        ),
        (
            lambda: ExhaustGas(heat_capacity_ratio=0.9),
            "'gas.heat_capacity_ratio' must be finite and above 1, but it is",
        ),
        (lambda: vgtjax.SpeedMap(side_speed=0.0), "'vane_force.side_speed' must be finite and above 0, but it is 0"),
        (
            lambda: vgtjax.HysteresisMap(reversal_distance=0),
            "'vane_force.reversal_distance' must be finite and above 0",
        ),
        (lambda: LevantDifferentiator(width=0.0), "'LevantDifferentiator.width' must be finite and above 0, but it is"),
        (lambda: ImplicitLevantDifferentiator(0.0), "largest_second_derivative' must be finite and above 0, but it is"),
        (lambda: ScheduledPI(sign_width=0.0), "'ScheduledPI.sign_width' must be finite and above 0, but it is 0"),
        (lambda: AdaptiveBackstepping(reversal_width=0.0), "reversal_width' must be finite and above 0, but it is 0"),
        (lambda: vgtjax.Air(pressure=float("nan")), "'air.pressure' must be finite and not negative, but it is nan"),
        (lambda: vgtjax.Diaphragm(preload=float("inf")), "'diaphragm.preload' must be finite, but it is inf; correct"),
        (lambda: vgtjax.Converter(magnetic_force=[0, 1, float("nan"), 0, 0]), "'converter.magnetic_force' must be"),
        (lambda: vgtjax.Coulomb(coulomb_force=np.array([2.8, -0.1])), "'friction.coulomb_force' .* but it is -0.1"),
        (
            lambda: vgtjax.replace_parameters(vgtjax.Actuator(), {"diaphragm.mass": -0.63}),
            "'diaphragm.mass' must be finite and not negative, but it is -0.63; correct it",
        ),
        (
            lambda: vgtjax.replace_parameters(vgtjax.Actuator(), {"diaphragm.masss": 1.0}),
            "parameter 'diaphragm.masss' matches nothing; did you mean 'diaphragm.mass'?",
        ),
    ],
)
def test_a_value_outside_its_domain_is_refused_wherever_it_comes_from(build, message):
    with pytest.raises(vgtjax.InputError, match=message):
        build()


def test_an_endless_travel_and_zero_are_values():
    assert np.isinf(vgtjax.Diaphragm(travel=np.inf).travel)
    assert vgtjax.Diaphragm(stiffness=0.0).stiffness == 0


def test_nesting_has_no_part_in_names():
    """An air path and a rod, put together, have the names that the parts have in the actuator."""
    plant = vgtjax.Plant(rod=vgtjax.plants.Rod(friction=vgtjax.Dahl()))
    table = vgtjax.parameter_table(plant)
    assert "diaphragm.stiffness" in table
    assert not [name for name in table if "rod" in name or "air_path" in name]
    assert vgtjax.get_parameter(plant, "friction.coulomb_force") is plant.rod.friction.coulomb_force


def test_every_array_of_the_model_is_in_the_table(actuator, table):
    assert len(jax.tree.leaves(actuator)) == len(table)


def test_every_row_says_symbol_unit_and_source(table):
    for name, row in table.items():
        assert row.name == name
        assert row.symbol
        assert row.source
        assert row.unit
        assert row.size is None or len(row.unit) == row.size
    assert {name: row.size for name, row in table.items() if row.size} == {
        "converter.magnetic_force": 5,
        "converter.atmosphere_orifice": 3,
    }


def test_assumed_values_are_marked(table):
    marked = {name for name, row in table.items() if row.assumed}
    assert marked == {"air.temperature", "diaphragm.stop_stiffness", "diaphragm.stop_damping"}


def test_what_is_held_by_default_is_what_the_study_format_says(actuator, table):
    assert {name for name, row in table.items() if row.held} == HELD
    free = {entry.partition("[")[0] for entry in vgtjax.select(actuator).entries}
    assert free == set(table) - HELD


def test_the_mechanical_model_has_no_converter():
    free = vgtjax.select(vgtjax.MechanicalActuator()).entries
    assert {entry.partition(".")[0] for entry in free} == {"diaphragm", "friction"}


@pytest.mark.parametrize(
    ("free", "fixed", "expected"),
    [
        (["diaphragm.stiffness"], [], ["diaphragm.stiffness"]),
        (["*.stiffness", "chamber.*"], [], ["chamber.volume", "diaphragm.stiffness"]),
        (["friction.[bv]*"], ["*_damping"], ["friction.bristle_stiffness"]),
        (["air.*"], ["air.p*"], ["air.gas_constant", "air.heat_capacity_ratio", "air.temperature"]),
        (["converter.magnetic_force[2]"], [], ["converter.magnetic_force[2]"]),
        (["converter.magnetic_force"], [], [f"converter.magnetic_force[{k}]" for k in range(5)]),
        (
            ["converter.magnetic_force"],
            ["converter.magnetic_force[2]", "*[4]"],
            [f"converter.magnetic_force[{k}]" for k in (0, 1, 3)],
        ),
        (["*.*_orifice[1]"], [], ["converter.atmosphere_orifice[1]"]),
        (["diaphragm.mass"], ["diaphragm.mass"], []),
        ([], [], []),
    ],
)
def test_patterns_select_in_the_order_of_the_table_and_fixed_beats_free(actuator, free, fixed, expected):
    assert list(vgtjax.select(actuator, free, fixed).entries) == expected


def test_fixed_alone_takes_away_from_the_default(actuator):
    default = vgtjax.select(actuator).entries
    fewer = vgtjax.select(actuator, fixed=["converter.*"]).entries
    assert fewer == tuple(entry for entry in default if not entry.startswith("converter."))


@pytest.mark.parametrize(
    ("pattern", "nearest"),
    [
        ("diaphragm.stifness", "diaphragm.stiffness"),
        ("stiffness", "diaphragm.stiffness"),
        ("frictoin.*", "friction.static_force"),
        ("converter.magnetic_force[5]", "converter.magnetic_force[4]"),
        ("diaphragm.stiffness[0]", "diaphragm.stiffness"),
        ("Chamber.volume", "chamber.volume"),
    ],
)
@pytest.mark.parametrize("where", ["free", "fixed"])
def test_a_name_that_matches_nothing_suggests_the_nearest(actuator, where, pattern, nearest):
    with pytest.raises(
        vgtjax.InputError,
        match=f"^{re.escape(f'parameter name or pattern {pattern!r} matches nothing; did you mean ')}",
    ) as caught:
        vgtjax.select(actuator, **{where: [pattern]})
    if "*" not in pattern:  # the nearest to a pattern is any name it might have meant
        assert str(caught.value).endswith(f"'{nearest}'?")


def test_match_entries_joins_what_several_patterns_find(table):
    assert match_entries(table, ["chamber.*", "chamber.volume", "air.pressure"]) == {"chamber.volume", "air.pressure"}


def test_an_entry_of_a_vector_has_its_own_unit_and_symbol(table):
    row = table_row(table, "converter.magnetic_force[2]")
    assert (row.name, row.symbol, row.unit, row.size) == ("converter.magnetic_force[2]", "c2", "N/%^2", None)


def test_pack_and_unpack_are_inverse_and_leave_the_rest_alone(actuator):
    selection = vgtjax.select(
        actuator, ["converter.magnetic_force[2]", "diaphragm.mass", "converter.atmosphere_orifice"]
    )
    vector = jnp.asarray([1.0, 2.0, 3.0, 4.0, 5.0])
    changed = selection.unpack(actuator, vector)
    np.testing.assert_array_equal(selection.pack(changed), vector)
    kept = changed.converter.magnetic_force.coefficients[jnp.array([0, 1, 3, 4])]
    np.testing.assert_array_equal(kept, [0.021731, 0.0022634, -3.5733e-5, 9.1355e-8])
    assert float(changed.diaphragm.stiffness) == 12000.0
    assert float(actuator.diaphragm.mass) == 0.63


def test_replacing_nothing_changes_nothing(actuator):
    assert vgtjax.replace_parameters(actuator, {}) is actuator


# -- the coordinates of a fit -------------------------------------------------------------------------------------

ENTRIES = ("diaphragm.preload", "diaphragm.stiffness", "diaphragm.damping", "converter.magnetic_force[4]")
START = np.array([-7.0, 11e3, 0.0, 0.0])


@pytest.fixture
def transform(table) -> Transform:
    return build_transform(
        table, ENTRIES, START, {"diaphragm.preload": (-10.0, 60.0), "diaphragm.stiffness": (8e3, None)}
    )


def test_transforms_round_trip(transform):
    values = jnp.asarray([-3.0, 1e4, 2.0, 1e-7])
    np.testing.assert_allclose(transform.to_physical(transform.to_coordinates(values)), values, rtol=1e-14)
    coordinates = jnp.asarray([-0.3, 9.2, 1.5, -2.0])
    np.testing.assert_allclose(transform.to_coordinates(transform.to_physical(coordinates)), coordinates, rtol=1e-13)


def test_positive_parameters_move_by_their_logarithm_and_others_by_their_size(transform):
    _, slope = jax.jvp(transform.to_physical, (transform.to_coordinates(jnp.asarray(START)),), (jnp.ones(4),))
    # A start of zero has the size of the printed value, or of one unit where that is zero too.
    np.testing.assert_allclose(slope, [7.0, 11e3, 1.0, 9.1355e-8], rtol=1e-13)


def test_clipping_ends_exactly_on_the_bounds(transform):
    clipped = transform.to_physical(transform.clip(jnp.full(4, -50.0)))
    np.testing.assert_allclose(clipped[:3], [-10.0, 8e3, 0.0], rtol=1e-14)
    assert transform.at_bound(transform.clip(jnp.full(4, -50.0))).tolist() == [True, True, True, False]
    assert transform.to_physical(transform.clip(jnp.full(4, 50.0)))[0] == pytest.approx(60.0, rel=1e-14)


def test_a_bound_holds_only_what_would_be_pushed_through_it(transform):
    low = transform.clip(jnp.full(4, -50.0))
    assert transform.pinned(low, jnp.ones(4)).tolist() == [True, True, True, False]
    assert not transform.pinned(low, -jnp.ones(4)).any()


@pytest.mark.parametrize("start", [8e3, 16e3])
def test_a_start_value_may_lie_on_its_bound(table, start):
    built = build_transform(table, ["diaphragm.stiffness"], np.array([start]), {"diaphragm.stiffness": (8e3, 16e3)})
    assert built.at_bound(built.to_coordinates(jnp.asarray([start])))[0]


@pytest.mark.parametrize(("start", "bounds"), [(7e3, (8e3, None)), (17e3, (None, 16e3))])
def test_a_start_value_must_lie_inside_its_bounds(table, start, bounds):
    with pytest.raises(
        vgtjax.InputError,
        match=rf"^the start value of 'diaphragm\.stiffness' must lie between .*, but it is {start:g}; change the value",
    ):
        build_transform(table, ["diaphragm.stiffness"], np.array([start]), {"diaphragm.stiffness": bounds})


def test_scales_may_be_others_than_those_of_the_table(table):
    """A positive entry that moves linearly keeps a thousandth of its start value, or its own bound above that."""
    entries, start = ["diaphragm.stiffness", "diaphragm.mass", "diaphragm.preload"], np.array([11e3, 0.6, 7.0])
    scales = {"diaphragm.stiffness": "linear", "diaphragm.mass": "linear", "diaphragm.preload": "log"}
    built = build_transform(table, entries, start, {"diaphragm.mass": (0.1, 2.0)}, scales)
    assert built.positive.tolist() == [False, False, True]
    np.testing.assert_allclose(built.to_coordinates(start), [1.0, 1.0, np.log(7.0)], rtol=1e-14)
    np.testing.assert_allclose(built.to_physical(built.to_coordinates(start)), start, rtol=1e-14)
    lowest, highest = (built.to_physical(built.clip(np.full(3, end))) for end in (-50.0, 50.0))
    np.testing.assert_allclose(lowest[:2], [11.0, 0.1], rtol=1e-14)
    assert lowest[2] > 0
    assert highest[1] == pytest.approx(2.0, rel=1e-14)


def test_what_is_not_positive_has_no_logarithm(table):
    with pytest.raises(vgtjax.InputError, match=r"by its logarithm, but it is -7; change it, or its scale to linear"):
        build_transform(table, ["diaphragm.preload"], np.array([-7.0]), {}, {"diaphragm.preload": "log"})


def test_a_positive_parameter_has_no_logarithm_at_zero(table):
    with pytest.raises(vgtjax.InputError, match="must be positive to be fitted, but it is 0; change it, or hold"):
        build_transform(table, ["diaphragm.stiffness"], np.array([0.0]), {})


def test_a_search_keeps_off_the_end_of_an_open_domain():
    table = vgtjax.parameter_table(vgtjax.Air())
    transform = build_transform(table, ["heat_capacity_ratio"], np.array([1.396]), {})
    nearest = float(transform.to_physical(transform.clip(np.array([-5.0])))[0])
    assert 1 < nearest < 1.001
    with pytest.raises(vgtjax.InputError, match=r"'heat_capacity_ratio' must be finite and above 1, but it is 0\.5"):
        vgtjax.replace_parameters(vgtjax.Air(), {"heat_capacity_ratio": 0.5})


def test_a_map_names_the_parameters_with_its_knots():
    model = vgtjax.PlungerMapActuator(flow_map=vgtjax.parts.LiftTable(), vane_force=vgtjax.SpeedMap())
    axes = {name: row.axes for name, row in vgtjax.parameter_table(model).items() if row.axes}
    pair = ("vane_force.turbine_pressure", "vane_force.crank_angle")
    expected = {"flow_map.flow": ("flow_map.position", "flow_map.pressure")}
    assert axes == expected | {f"vane_force.{side}": pair for side in ("closing", "opening")}
    assert list(vgtjax.SpeedMap().tables) == ["closing", "opening"]
    assert list(vgtjax.AdaptiveLuGre().tables) == ["load"]
    steady = vgtjax.parameter_table(vgtjax.parts.SteadyPlungerFlow())
    assert steady["table.flow"].axes == ("table.position", "table.pressure")


def test_help_lists_every_parameter_of_a_part_inherited_ones_too():
    described = {kind: [f.name for f in dataclasses.fields(kind) if "parameter" in f.metadata] for kind in parts(Part)}
    assert described[vgtjax.SpeedMap][0] == "closing"
    plain = type("Plain", (vgtjax.LuGre,), {"__module__": "mine"})
    assert plain.__doc__.startswith("Plain\n\n**Parameters:**")
    for kind, names in described.items():
        assert re.findall(r"(?m)^- `(\w+)`: ", kind.__doc__.partition("**Parameters:**")[2]) == names, kind
