"""What is said of samples whose friction could give out energy."""

import pytest

import vgtjax
from calibrate.population import describe_active, say_active
from vgtjax.population import make_sample, spread_population

OTHERS = ["friction.bristle_damping", "friction.static_force"]
DRAWN = "of 64 samples had friction that, as drawn, could give out energy"


RAISED = (
    "; the viscous damping of such a sample was raised to the least of passive friction (passive = false under "
    "[population] leaves it)"
)


@pytest.mark.parametrize("vary", [[*OTHERS, "friction.viscous_damping"], OTHERS], ids=["varies", "held"])
@pytest.mark.parametrize(("passive", "done"), [(True, RAISED), (False, "")], ids=["raised", "as asked for"])
def test_it_is_said_what_was_done_about_them(vary, passive, done):
    population = spread_population(vgtjax.Actuator(), 0.5, vary=vary, passive=passive)
    found = describe_active(population, make_sample(population.dimensions, 64, "sobol", 0))
    assert found["count"] > 0
    assert found["raised"] is passive
    assert say_active(population, found["count"], 64) == f"{found['count']} {DRAWN}{done}"
    assert say_active(population, 0, 64) is None
