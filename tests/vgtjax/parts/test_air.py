"""Compressible flow: closed forms, continuity, direction, and derivatives where they are delicate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import Air, flow_function, orifice_flow

AIR = Air()
GAMMA = 1.396


def textbook_flow_function(ratio):
    """[2.15] with 2/(gamma-1) under the root (erratum)."""
    critical = (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1))
    ratio = np.maximum(ratio, critical)
    return np.sqrt(2 / (GAMMA - 1) * (ratio ** (2 / GAMMA) - ratio ** ((GAMMA + 1) / GAMMA)))


def test_flow_function_is_the_textbook_one():
    ratios = np.linspace(0.05, 0.9998, 400)
    ours = np.array([flow_function(AIR, r) for r in ratios])
    np.testing.assert_allclose(ours, textbook_flow_function(ratios), rtol=1e-10)  # exp(log) against pow


def test_choked_value_and_continuity_at_the_critical_ratio():
    critical = AIR.critical_ratio()
    choked = (2 / (GAMMA + 1)) ** ((GAMMA + 1) / (2 * (GAMMA - 1)))
    assert choked == pytest.approx(0.5790, abs=1e-4)
    for ratio in (0.1, critical * (1 - 1e-12), critical * (1 + 1e-12)):
        assert flow_function(AIR, ratio) == pytest.approx(choked, rel=1e-10)


def test_flow_function_ends_at_zero_with_a_finite_slope():
    assert flow_function(AIR, 1.0) == 0.0
    slope = jax.grad(lambda r: flow_function(AIR, r))(1.0)
    assert np.isfinite(slope)
    assert slope < 0


def test_chord_costs_little_where_it_replaces_the_root():
    """Largest error at a quarter of the chord; a fraction of the flow at its foot, where hardly anything flows."""
    error = abs(flow_function(AIR, 0.999975) - textbook_flow_function(0.999975))
    assert error < 0.01 * textbook_flow_function(0.5)


def flow(source, volume, temperature=250.0):
    return orifice_flow(AIR, jnp.asarray(1e-6), jnp.asarray(source), jnp.asarray(volume), jnp.asarray(temperature))


def test_flow_follows_the_pressure_and_carries_the_temperature_it_comes_from():
    inward, entering = flow(1.0e5, 5.0e4)
    outward, leaving = flow(5.0e4, 1.0e5)
    assert inward > 0 > outward
    assert entering == 293.15
    assert leaving == 250.0


def test_choked_flow_has_its_closed_form():
    choked = (2 / (GAMMA + 1)) ** ((GAMMA + 1) / (2 * (GAMMA - 1)))
    expected = 1e-6 * 1.0e5 * np.sqrt(GAMMA / (286.7 * 293.15)) * choked
    assert flow(1.0e5, 3.0e4)[0] == pytest.approx(expected, rel=1e-12)


def test_reversal_is_continuous_and_its_derivative_finite():
    below, above = flow(1.0e5, 1.0e5 - 1e-3)[0], flow(1.0e5, 1.0e5 + 1e-3)[0]
    assert below == pytest.approx(-float(above), rel=0.1)  # the two sides differ by their temperatures, sqrt(293/250)
    assert abs(below) < 1e-9
    for pressure in (1.0e5, 2.0e4, 0.0):
        slopes = jax.grad(lambda p: flow(1.0e5, p)[0])(pressure)
        assert np.isfinite(slopes)


def test_flow_at_equal_pressures_feels_both():
    """A vented chamber rests there; `maximum` and `minimum` would split the tie and say that nothing changes."""
    even, area = jnp.asarray(101013.0), jnp.asarray(1e-7)
    slopes = jax.grad(lambda source, pressure: orifice_flow(AIR, area, source, pressure, jnp.asarray(290.0))[0], (0, 1))
    by_source, by_pressure = slopes(even, even)
    step = 0.1  # Pa, well inside the chord
    flow = orifice_flow(AIR, area, even, even - step, jnp.asarray(290.0))[0]
    assert by_pressure == pytest.approx(-float(flow) / step, rel=0.02)  # gas of 290 or of 293 K: 0.5 %
    assert by_source == pytest.approx(-float(by_pressure), rel=0.02)


def test_a_wide_orifice_passes_no_more_than_its_conductance():
    """From where the limit is reached down to equal pressures, where the slope is the limit itself."""
    even, conductance = 101013.0, 1e-8

    def limited(pressure, area, conductance=conductance):
        return orifice_flow(AIR, jnp.asarray(area), even, pressure, AIR.temperature, conductance)[0]

    for difference in (0.0, 1.0, -1.0, 100.0, 1000.0):
        found, slope = jax.value_and_grad(limited)(even - difference, 1e-5)
        assert found == pytest.approx(conductance * difference, rel=1e-6)
        assert slope == pytest.approx(-conductance, rel=0.02)  # differences are up to 1 % of the pressure
    for difference in (0.0, 1.0, 1000.0, 8e4):
        narrow = 1e-12
        assert limited(even - difference, narrow) == limited(even - difference, narrow, None)
    opening = jax.grad(limited, 1)(even - 1000.0, 0.0)
    assert opening == pytest.approx(float(jax.grad(limited, 1)(even - 1000.0, 0.0, None)), rel=1e-12)
