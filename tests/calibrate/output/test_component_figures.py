"""Figures of components."""

import numpy as np
import pytest

import vgtjax
from calibrate.output.component_figures import component_figures, vane_force_figure
from vgtjax.parts.vane_force import AbstractStatelessVaneForce


@pytest.mark.parametrize("kind", [vgtjax.HysteresisMap, vgtjax.SpeedMap])
def test_a_map_shows_both_tables_at_its_own_pressures(kind):
    figure = vane_force_figure(vgtjax.Actuator(vane_force=kind(closing=np.full(12, 2.0), opening=np.full(12, -1.0))))
    shown = {each.name: np.asarray(each.y) for each in figure.data}
    assert list(shown) == ["1500 mbar closing", "1500 mbar opening", "3000 mbar closing", "3000 mbar opening"]
    np.testing.assert_allclose(shown["3000 mbar closing"], 2.0)
    np.testing.assert_allclose(shown["3000 mbar opening"], -1.0)


@pytest.mark.parametrize(
    ("gauge", "expected"),
    [([2e5, 1e5, 1.02e5, 0.0], ["1000 mbar", "2000 mbar"]), ([], ["500 mbar", "1000 mbar", "1500 mbar"])],
)
def test_a_law_over_pressure_is_shown_at_those_of_the_traces(gauge, expected):
    """Loops at nearly one pressure are one curve, and without gas there is no force."""
    clock = np.arange(3.0)
    traces = [vgtjax.Trace(clock, p_act=9e4 + 0 * clock, p_trb=each + 0 * clock) for each in gauge]
    model = vgtjax.MechanicalActuator(vane_force=vgtjax.ForcePolynomial())
    title, figure = component_figures(model, traces)[-1]
    assert title == "Exhaust gas force on the rod [3.15]"
    assert [each.name for each in figure.data] == expected


class Push(AbstractStatelessVaneForce):
    """A law of one's own, which knows of no crank: what the gas before the turbine does to 1 cm2."""

    def __call__(self, vanes, velocity, state):
        return 1e-4 * vanes.turbine_pressure, None

    def relaxation(self, vanes, velocity, state):
        return None


def test_a_law_without_a_crank_is_shown_over_the_opening():
    figure = vane_force_figure(vgtjax.MechanicalActuator(vane_force=Push()))
    assert figure.layout.xaxis.title.text == "opening, mm"
    np.testing.assert_allclose([each.y[0] for each in figure.data], [5.0, 10.0, 15.0])
    assert figure.data[0].x[-1] == pytest.approx(1e3 * vgtjax.MechanicalActuator().diaphragm.travel)


def test_a_plant_of_parts_shows_the_laws_of_the_actuator_of_these():
    whole = vgtjax.Actuator(converter=vgtjax.Converter(return_spring_stiffness=900.0))
    parts = vgtjax.Plant(whole.air_path, whole.rod, whole.air)
    theirs, ours = (component_figures(model, []) for model in (whole, parts))
    assert [title for title, _ in ours] == [title for title, _ in theirs]
    assert [figure.to_json() for _, figure in ours] == [figure.to_json() for _, figure in theirs]
