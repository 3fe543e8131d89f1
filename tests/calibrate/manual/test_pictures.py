"""The manual's pictures show what the model says, and there are no others."""

import re

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from markdown_pages import PAGES, ROOT

import vgtjax
from calibrate.manual import pictures


@pytest.fixture(autouse=True)
def _closed():
    """Without a screen, and nothing left open."""
    matplotlib.use("Agg")
    yield
    plt.close("all")


def test_flow_is_choked_and_the_plunger_opens_one_orifice_at_a_time():
    flow, force, area = (axis.lines[0].get_data() for axis in pictures.converter().axes)
    np.testing.assert_allclose(flow[1][flow[0] < 0.5], flow[1][0], rtol=1e-12)
    assert flow[1][-1] == 0.0
    assert force[1][-1] == pytest.approx(12.65, abs=0.01)  # the printed quartic at full duty
    assert np.all(area[1] >= 0)
    assert area[1][np.abs(area[0]).argmin()] < 1e-12


def test_friction_stays_between_coulomb_and_stiction():
    (axis,) = pictures.friction().axes
    lugre, dahl = (np.abs(line.get_ydata()).max() for line in axis.lines)
    law, fastest = vgtjax.LuGre(), 2e-4 * 0.8 * np.pi
    assert law.coulomb_force < lugre < law.static_force + law.viscous_damping * fastest
    assert dahl == pytest.approx(2.8, rel=0.05)  # its F_c, which it comes near in 0.4 mm, and bristles without damping


def test_pages_show_what_is_drawn():
    drawn = set(
        re.findall(r'save\("(\w+)"', (ROOT / "calibrate" / "manual" / "pictures.py").read_text(encoding="utf-8"))
    )
    shown = {name for page in PAGES for name in re.findall(r"images/(\w+)\.svg", page.read_text(encoding="utf-8"))}
    assert shown == drawn == {path.stem for path in pictures.IMAGES.iterdir()}


def test_a_picture_is_the_same_file_each_time(tmp_path):
    for folder in ("one", "two"):
        with plt.rc_context(pictures.STYLE):
            pictures.save("converter", pictures.converter(), tmp_path / folder)
    assert (tmp_path / "one" / "converter.svg").read_bytes() == (tmp_path / "two" / "converter.svg").read_bytes()
