"""Which actuators can't exist, and that they are refused."""

import jax
import numpy as np
import pytest

import vgtjax
from vgtjax import InputError
from vgtjax.plants import Instrumented, least_volume, require_physical
from vgtjax.simulation import RESULTS, blame

SWEPT = 2.9224e-3 * 10.13e-3
"""m3, printed."""
SENTENCE = (
    r"'chamber.volume' must be larger than what the diaphragm sweeps, diaphragm.area times diaphragm.travel "
    r"\(2.96e-05 m3\), but it is 2.9e-05 m3; enlarge it, or correct area or travel"
)
MODELS = [vgtjax.Actuator, vgtjax.PneumaticActuator, vgtjax.PlungerMapActuator, vgtjax.StaticMapActuator]


def too_small(kind):
    return vgtjax.replace_parameters(kind(), {"chamber.volume": 2.9e-5})


@pytest.mark.parametrize("kind", MODELS)
def test_a_chamber_is_larger_than_what_the_diaphragm_sweeps(kind):
    require_physical(kind())
    assert least_volume(kind()) == pytest.approx(60e-6 - SWEPT, rel=1e-12)
    with pytest.raises(InputError, match=SENTENCE) as refused:
        require_physical(too_small(kind))
    assert refused.value.argument == "values"


def test_without_a_chamber_or_an_end_stop_nothing_is_swallowed():
    assert least_volume(vgtjax.MechanicalActuator()) is None
    require_physical(vgtjax.MechanicalActuator())
    endless = vgtjax.replace_parameters(vgtjax.Actuator(), {"diaphragm.travel": np.inf})
    assert least_volume(endless) == np.inf
    require_physical(endless)


def test_sensors_hide_nothing():
    seen = Instrumented(too_small(vgtjax.Actuator))
    assert least_volume(seen) == pytest.approx(2.9e-5 - SWEPT)
    with pytest.raises(InputError, match=SENTENCE):
        require_physical(seen)
    trace = vgtjax.Trace(np.arange(20) * 1e-3, pwm=np.full(20, 50.0), p_res=np.full(20, 2e4))
    assert vgtjax.simulate(seen, trace, throw=False).result == vgtjax.RESULTS.unphysical


def test_that_is_the_cause_whatever_else_is_wrong(monkeypatch):
    monkeypatch.setattr("vgtjax.simulation._results.lost_points", lambda model: np.asarray(True))
    causes = [blame(model, RESULTS.diverged) for model in (vgtjax.Actuator(), too_small(vgtjax.Actuator))]
    assert causes == [RESULTS.no_steady_flow, RESULTS.unphysical]


def test_traced_values_are_not_looked_at():
    def volume(model):
        require_physical(model)
        return least_volume(model)

    assert jax.jit(volume)(too_small(vgtjax.Actuator)) == pytest.approx(2.9e-5 - SWEPT)


def test_a_fit_does_not_begin_there():
    time = np.arange(20) * 1e-3
    trace = vgtjax.Trace(time, pwm=0 * time, p_res=0 * time + 2e4, x_d=0 * time)
    with pytest.raises(InputError, match=SENTENCE):
        vgtjax.identification.plan_fit(too_small(vgtjax.Actuator), [trace])
