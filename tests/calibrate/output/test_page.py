"""Sentences as a report prints them."""

import pathlib

import pytest

import calibrate
from calibrate.output.page import _sentence

TEMPLATES = pathlib.Path(calibrate.__file__).parent / "templates"


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


def test_units_stay_as_they_are_written():
    """A filter of Jinja's that makes a first letter large makes all others small: 12 n s/m."""
    said = "friction is not passive: friction.viscous_damping must be 12 N s/m larger"
    assert _sentence(said) == f"F{said[1:]}."
    assert [path.name for path in TEMPLATES.glob("*.jinja") if "capitalize" in path.read_text(encoding="utf-8")] == []
