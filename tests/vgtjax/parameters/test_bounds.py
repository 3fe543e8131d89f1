"""Bounds by name and by entry: what they are on, who breaks them, and the nearest values inside."""

import numpy as np
import pytest

import vgtjax
from vgtjax.parameters import bounds_by_entry, check_bounds, move_inside


@pytest.fixture
def model():
    return vgtjax.MechanicalActuator()


def test_a_name_a_pattern_and_an_entry_bound_their_entries_in_the_order_of_the_table(actuator):
    found = bounds_by_entry(
        actuator,
        {"friction.*_force": (0.5, None), "converter.magnetic_force[2]": (None, 1.0), "chamber.volume": (0, 1)},
    )
    assert found == {
        "converter.magnetic_force[2]": (None, 1.0),
        "chamber.volume": (0, 1),
        "friction.static_force": (0.5, None),
        "friction.coulomb_force": (0.5, None),
    }
    order = list(vgtjax.select(actuator, free=["*"]).entries)
    assert sorted(found, key=order.index) == list(found)


def test_the_later_of_two_bounds_counts(model):
    assert bounds_by_entry(model, {"diaphragm.*": (0, 9), "diaphragm.mass": (1, 2)})["diaphragm.mass"] == (1, 2)


def test_bounds_of_nothing_are_refused_with_the_argument_at_fault(model):
    with pytest.raises(
        vgtjax.InputError, match=r"'diaphragm\.mas' matches nothing; did you mean 'diaphragm\.mass'"
    ) as error:
        bounds_by_entry(model, {"diaphragm.mas": (0, 1)})
    assert error.value.argument == "bounds"


@pytest.mark.parametrize(
    ("bounds", "sentence"),
    [
        ((0.7, None), r"^'diaphragm\.mass' must be at least 0\.7, but it is 0\.63; change one$"),
        ((None, 0.6), r"^'diaphragm\.mass' must be at most 0\.6, but it is 0\.63; change one$"),
    ],
)
def test_a_value_beyond_its_bound_is_refused_though_it_is_held(model, bounds, sentence):
    with pytest.raises(vgtjax.InputError, match=sentence) as error:
        check_bounds(model, {"diaphragm.mass": bounds})
    assert error.value.argument == "bounds"


def test_values_on_their_bounds_are_inside(model):
    check_bounds(model, {"diaphragm.mass": (0.63, 0.63), "diaphragm.preload": (None, None)})


def test_what_lies_outside_is_moved_to_its_bound_and_nothing_else_is_moved(actuator):
    moved = move_inside(
        actuator,
        {
            "diaphragm.mass": (0.7, None),
            "diaphragm.preload": (None, 40.0),
            "diaphragm.stiffness": (1.0, 1e6),
            "converter.magnetic_force[1]": (1.0, None),
            "vane_force.closing[0]": (1.0, None),  # of another model
        },
    )
    assert float(moved.diaphragm.mass) == 0.7
    assert float(moved.diaphragm.preload) == 40.0
    assert float(moved.diaphragm.stiffness) == float(actuator.diaphragm.stiffness)
    before, after = (np.asarray(vgtjax.get_parameter(m, "converter.magnetic_force")) for m in (actuator, moved))
    assert after[1] == 1.0
    np.testing.assert_array_equal(np.delete(after, 1), np.delete(before, 1))
