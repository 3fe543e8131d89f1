"""The report on top of several units."""

import pathlib
import types

from pages import Page

from calibrate.identify.report import render_overview
from calibrate.study.units import prepare


def summary(**told: int):
    """A unit whose tests told so many values each."""
    sections = [{"name": name, "values": dict.fromkeys(range(count))} for name, count in told.items()]
    return {"sections": sections, "wall_seconds": 1.5}


def test_counts_stand_under_the_names_of_their_tests(folder: pathlib.Path):
    """Of units that have not the same tests."""
    job = prepare(folder / "study.toml", None)
    units = {"a": summary(spring=2, friction=0), "b": summary(spring=3, gas=12, friction=4)}
    table = Page(render_overview(job, types.MappingProxyType(units))).table("unit")
    assert table == [
        {"unit": "a", "spring": "2", "friction": "\u2013", "gas": "", "seconds": "1.5"},
        {"unit": "b", "spring": "3", "friction": "4", "gas": "12", "seconds": "1.5"},
    ]
