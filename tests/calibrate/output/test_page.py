"""Sentences as a report prints them."""

import pytest

from calibrate.output.page import _sentence


@pytest.mark.parametrize(
    ("said", "printed"),
    [
        ("the duty is late", "The duty is late."),
        ("diaphragm.area hardly shows", "diaphragm.area hardly shows."),
        (
            "friction.static_force, diaphragm.mass scale together",
            "friction.static_force, diaphragm.mass scale together.",
        ),
        ("x", "X."),
    ],
)
def test_a_name_in_front_stays_as_it_is_written(said, printed):
    assert _sentence(said) == printed
