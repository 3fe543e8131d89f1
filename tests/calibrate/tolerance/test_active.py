"""What is said of samples whose friction could give out energy."""

import pytest

import vgtjax
from calibrate.population import describe_active, say_active
from vgtjax.population import make_sample, spread_population

OTHERS = ["friction.bristle_damping", "friction.static_force"]
DRAWN = "of 64 samples had friction that, as drawn, could give out energy"


@pytest.mark.parametrize(
    ("vary", "passive", "done"),
    [
        (
            [*OTHERS, "friction.viscous_damping"],
            True,
            "; the viscous damping of such a sample was raised to the least of passive friction (passive = false under "
            "[population] leaves it)",
        ),
        (
            OTHERS,
            True,
            "; nothing was raised, as friction.viscous_damping does not vary: name it under vary of [population], or "
            "free it in the fits of units",
        ),
        (OTHERS, False, ""),
    ],
    ids=["raised", "held", "as asked for"],
)
def test_it_is_said_what_was_done_about_them(vary, passive, done):
    population = spread_population(vgtjax.Actuator(), 0.5, vary=vary, passive=passive)
    found = describe_active(population, make_sample(population.dimensions, 64, "sobol", 0))
    assert found["count"] > 0
    assert found["raised"] is done.startswith("; the")
    assert say_active(population, found["count"], 64) == f"{found['count']} {DRAWN}{done}"
    assert say_active(population, 0, 64) is None
