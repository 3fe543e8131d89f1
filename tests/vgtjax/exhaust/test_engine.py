"""Volumes of the cylinders and areas of the valves, by hand."""

import jax
import numpy as np
import pytest

from vgtjax.exhaust import Engine, Valve

ENGINE, VALVE = Engine(), Valve()


def test_a_cylinder_is_smallest_at_the_top_and_largest_at_the_bottom():
    swept = np.pi / 4 * 0.075**2 * 2 * 0.0455
    np.testing.assert_allclose(ENGINE.volume(np.array([0.0, 360.0])), 23.6e-6, rtol=1e-12)  # rounding
    np.testing.assert_allclose(ENGINE.volume(np.array([180.0, 540.0])), 23.6e-6 + swept, rtol=1e-12)


def test_the_crank_turns_the_rod():
    angle = np.deg2rad(75.0)
    pin = 0.0455 * np.cos(angle) + np.sqrt(0.1365**2 - (0.0455 * np.sin(angle)) ** 2)
    stroke = 0.0455 + 0.1365 - pin
    assert float(ENGINE.volume(75.0)) == pytest.approx(23.6e-6 + np.pi / 4 * 0.075**2 * stroke, rel=1e-12)  # rounding


def test_the_clearance_volume_is_not_the_printed_one():
    ratio = float(ENGINE.volume(180.0) / ENGINE.volume(0.0))
    assert ratio == pytest.approx(18.0, abs=0.05)  # 23.6 cm3 has three digits
    printed = float(Engine(clearance_volume=4417.8e-9).volume(180.0)) / 4417.8e-9
    assert printed == pytest.approx(92.0, abs=0.05)
    assert np.pi / 4 * 0.075**2 * 1e-3 == pytest.approx(4417.8e-9, abs=0.1e-9)  # cut, not rounded, to its last digit


def test_displacement_is_that_of_the_printed_crank():
    swept = ENGINE.cylinders * float(ENGINE.volume(180.0) - ENGINE.volume(0.0))
    assert swept == pytest.approx(1608e-6, rel=1e-3)


def test_the_printed_torques_are_two_and_neither_is_that_of_the_assumed_charge():
    """280 N m (section 3.6) and 260 N m (B.2.1) at most are mean pressures of 21.9 and 20.3 bar. 0.476 g of gas in a
    cylinder are 24 mg of fuel at an air ratio of 1.3, which at 45 % are half of that."""
    swept = ENGINE.cylinders * float(ENGINE.volume(180.0) - ENGINE.volume(0.0))
    mean = [4 * np.pi * torque / swept / 1e5 for torque in (280.0, 260.0)]
    assert mean == pytest.approx([21.9, 20.3], abs=0.05)
    fuel = 0.476e-3 / (1 + 1.3 * 14.6)
    assert 0.45 * 42.8e6 * fuel * ENGINE.cylinders / swept / 1e5 == pytest.approx(0.56 * mean[1], rel=0.01)


def test_a_valve_is_open_between_its_angles_only():
    shut = VALVE.area(np.array([0.0, 139.9, 140.0, 370.0, 500.0, 719.0]))
    np.testing.assert_allclose(shut, 0.0, atol=1e-30)  # the square of the rounding of sin(pi)
    curtain, seat = np.pi * 0.022 * 0.0085, np.pi / 4 * 0.022**2
    fully = 2 * 0.65 * curtain * seat / np.hypot(curtain, seat)
    assert float(VALVE.area(255.0)) == pytest.approx(fully, rel=1e-12)  # rounding
    assert fully < 2 * 0.65 * min(curtain, seat)


def test_an_area_begins_without_a_slope():
    assert float(jax.grad(VALVE.area)(140.0)) == 0.0
    assert float(jax.grad(VALVE.area)(200.0)) > 0
