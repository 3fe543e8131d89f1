"""Figures of components."""

import numpy as np
import pytest

import vgtjax
from calibrate.output.component_figures import vane_force_figure


@pytest.mark.parametrize("kind", [vgtjax.HysteresisMap, vgtjax.SpeedMap])
def test_a_map_shows_both_tables_at_its_own_pressures(kind):
    figure = vane_force_figure(vgtjax.Actuator(vane_force=kind(closing=np.full(12, 2.0), opening=np.full(12, -1.0))))
    shown = {each.name: np.asarray(each.y) for each in figure.data}
    assert list(shown) == ["1500 mbar closing", "1500 mbar opening", "3000 mbar closing", "3000 mbar opening"]
    np.testing.assert_allclose(shown["3000 mbar closing"], 2.0)
    np.testing.assert_allclose(shown["3000 mbar opening"], -1.0)
