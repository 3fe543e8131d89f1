"""Names, patterns, what is held, and the coordinates in which a fit moves."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.parameters import match_entries, table_row
from vgtjax.transforms import Transform, build_transform

HELD = {
    *(f"air.{name}" for name in ("gas_constant", "heat_capacity_ratio", "pressure", "temperature")),
    *(f"converter.{name}" for name in ("plunger_mass", "actuator_area", "atmosphere_area", "reservoir_area")),
    "diaphragm.area",
    "diaphragm.damping",
}
"""What the study format holds by default."""


@pytest.fixture
def table(actuator) -> dict[str, vgtjax.Parameter]:
    return vgtjax.parameter_table(actuator)


def test_names_are_field_paths(actuator, table):
    for name in table:
        value = actuator
        for part in name.split("."):
            value = getattr(value, part)
        assert vgtjax.get_parameter(actuator, name) is value


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
    np.testing.assert_array_equal(
        changed.converter.magnetic_force[jnp.array([0, 1, 3, 4])], [0.021731, 0.0022634, -3.5733e-5, 9.1355e-8]
    )
    assert float(changed.diaphragm.stiffness) == 12000.0
    assert float(actuator.diaphragm.mass) == 0.63


def test_replacing_nothing_changes_nothing(actuator):
    assert vgtjax.replace_parameters(actuator, {}) is actuator


# -- the coordinates of a fit -------------------------------------------------------------------------------------

ENDS = {
    "free": (-np.inf, np.inf),
    "positive": (0.0, np.inf),
    "from below": (-3.0, np.inf),
    "from above": (-np.inf, 5.0),
    "box": (2.0, 4.0),
}
VALUES = {"free": -7.0, "positive": 1e-8, "from below": 12.0, "from above": -20.0, "box": 3.9}


@pytest.fixture
def transform() -> Transform:
    lower, upper = zip(*ENDS.values(), strict=True)
    return Transform(np.array(lower), np.array(upper), np.abs(np.array(list(VALUES.values()))))


def test_transforms_round_trip(transform):
    values = jnp.asarray(list(VALUES.values()))
    # Subtracting a bound and adding it again costs a few roundings of the larger number.
    np.testing.assert_allclose(transform.to_physical(transform.to_unconstrained(values)), values, rtol=1e-14)
    coordinates = jnp.asarray([-0.3, 0.2, 1.5, -2.0, 0.7])
    np.testing.assert_allclose(transform.to_unconstrained(transform.to_physical(coordinates)), coordinates, rtol=1e-13)


def test_any_coordinates_stay_inside_the_bounds(transform):
    lower, upper = (np.array(ends) for ends in zip(*ENDS.values(), strict=True))
    for coordinate in np.linspace(-30, 30, 61):
        values = np.asarray(transform.to_physical(jnp.full(len(ENDS), coordinate)))
        assert np.all((values >= lower) & (values <= upper))


def test_the_derivative_of_a_transform_is_that_of_its_closed_form(transform):
    at = jnp.asarray([-0.3, 0.2, 1.5, -2.0, 0.7])
    sigmoid = 1 / (1 + np.exp(-0.7))
    expected = [7.0, np.exp(0.2), np.exp(1.5), -np.exp(-2.0), 2.0 * sigmoid * (1 - sigmoid)]
    _, slope = jax.jvp(transform.to_physical, (at,), (jnp.ones(5),))
    np.testing.assert_allclose(slope, expected, rtol=1e-14)
    np.testing.assert_allclose(jax.jacfwd(transform.to_physical)(at), np.diag(expected), rtol=1e-14)


@pytest.mark.parametrize(
    ("entry", "start", "bounds", "ends"),
    [
        ("diaphragm.preload", 49.46, (None, None), (-np.inf, np.inf)),
        ("diaphragm.stiffness", 12e3, (None, None), (0.0, np.inf)),
        ("diaphragm.stiffness", 12e3, (-5.0, 16e3), (0.0, 16e3)),
        ("diaphragm.stiffness", 12e3, (8e3, None), (8e3, np.inf)),
        ("converter.magnetic_force[3]", -3.6e-5, (None, 0.0), (-np.inf, 0.0)),
    ],
)
def test_bounds_narrow_the_domain_of_the_table(table, entry, start, bounds, ends):
    built = build_transform(table, [entry], np.array([start]), {entry: bounds})
    assert (built.lower[0], built.upper[0]) == ends


@pytest.mark.parametrize(
    ("start", "bounds"), [(8e3, (8e3, 16e3)), (16e3, (8e3, 16e3)), (7e3, (8e3, None)), (17e3, (None, 16e3))]
)
def test_a_start_value_must_lie_inside_its_bounds(table, start, bounds):
    with pytest.raises(
        vgtjax.InputError,
        match=rf"^the start value of 'diaphragm\.stiffness' must lie strictly between .*, but it is {start:g}; change",
    ):
        build_transform(table, ["diaphragm.stiffness"], np.array([start]), {"diaphragm.stiffness": bounds})


def test_a_value_within_a_thousandth_of_its_range_is_at_its_bound():
    transform = Transform(np.zeros(4), np.full(4, 10.0), np.ones(4))
    np.testing.assert_array_equal(
        transform.at_bound(np.array([0.009, 0.011, 9.989, 9.991])), [True, False, False, True]
    )


def test_the_domain_of_the_table_is_no_bound():
    assert not Transform(np.zeros(1), np.full(1, np.inf), np.ones(1)).at_bound(np.array([1e-12]))[0]
