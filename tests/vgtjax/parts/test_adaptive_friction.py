"""LuGre friction under exhaust gas."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from axis import drag
from support import duty_trace

import vgtjax
from vgtjax import AdaptiveLuGre, Crank, LuGre
from vgtjax.parts import Bristle, Contact, Vanes

LOAD = [1.0, 2.0, 3.0, 4.0, 5.0, 10.0, 20.0, 30.0, 40.0, 50.0]
FRICTION = AdaptiveLuGre(load=LOAD)


def vanes(pressure, angle):
    return Vanes(Crank().opening(jnp.asarray(angle)), jnp.asarray(pressure))


def contact(velocity, pressure, angle=20.0):
    return Contact(jnp.asarray(velocity), jnp.asarray(0.63), vanes(pressure, angle))


@pytest.mark.parametrize(
    ("pressure", "angle", "load"),
    [
        (0.0, 20.0, 0.0),  # no gas, no load: the row of zeros that no table needs to have
        (-1e4, 20.0, 0.0),  # held beyond
        (1.5e5, 4.0, 1.0),  # on knots
        (3.0e5, 28.0, 40.0),
        (0.75e5, 12.0, 1.0),  # half way from none to the first row
        (2.25e5, 16.0, 13.75),  # in the middle of a cell
        (9.0e5, 60.0, 50.0),  # held beyond
    ],
)
def test_theta_is_linear_in_the_table(pressure, angle, load):
    assert FRICTION.theta(vanes(pressure, angle)) == pytest.approx(1 + load / 2.8, rel=1e-9)


@pytest.mark.parametrize("velocity", [0.0, 1e-4, -0.05])
@pytest.mark.parametrize("deflection", [0.0, 5e-5])
def test_all_of_friction_grows_and_the_bristles_move_alike(velocity, deflection):
    state = Bristle(jnp.asarray(deflection))
    cold, still = LuGre()(contact(velocity, 0.0), state, jnp.asarray(0.0))
    hot, rate = FRICTION(contact(velocity, 3e5), state, jnp.asarray(0.0))
    assert hot == pytest.approx(float(cold) * (1 + 30.0 / 2.8), rel=1e-9)
    assert rate.deflection == still.deflection


def test_slow_sliding_carries_the_load_on_top_of_coulomb_friction():
    speed = np.full(4000, 5e-3)  # past the Stribeck curve, 2 mm in all
    force = float(drag(FRICTION, speed, np.full(4000, 1e-4), 0.0)[0][-1])
    loaded = float(drag(FRICTION, speed, np.full(4000, 1e-4), 3e5)[0][-1])
    assert loaded - force == pytest.approx(FRICTION.theta(Vanes(jnp.asarray(5e-3), jnp.asarray(3e5))) * force - force)
    assert loaded > force + 20.0


def test_without_pressure_or_without_load_it_is_lugre():
    cold = duty_trace((0, 0.03), (80, 0.1), (20, 0.1), p_res=2.0e4)
    hot = duty_trace((0, 0.03), (80, 0.1), (20, 0.1), p_res=2.0e4, p_trb=2e5)
    for friction, trace in ((FRICTION, cold), (AdaptiveLuGre(), hot)):
        ours = vgtjax.simulate(vgtjax.Actuator(friction=friction), trace)
        np.testing.assert_array_equal(ours.x_d, vgtjax.simulate(vgtjax.Actuator(), trace).x_d)


def test_a_loop_widens_with_turbine_pressure():
    """Section 3.4.2: the same motion against a friction that grows."""
    place = 2e-3 * np.sin(2 * np.pi * np.arange(8001) / 4000)
    velocity, duration = np.diff(place) / 1e-3, np.full(8000, 1e-3)
    lost = [float(np.sum(drag(FRICTION, velocity, duration, p)[1][4000:])) for p in (0.0, 1e5, 2e5, 3e5)]
    assert np.all(np.diff(lost) > 0)
    assert lost[-1] > 5 * lost[0]


@pytest.mark.parametrize(("velocity", "deflection"), [(0.0, 0.0), (1e-12, 0.0), (-1e-3, 1e-3 * 635.77 / 43135.0)])
def test_slopes_are_central_differences_where_friction_passes_through_zero(velocity, deflection):
    """(3.20) divides by the friction itself, and would be singular there."""

    def force(v, z, load, pressure, angle):
        friction = AdaptiveLuGre(load=load)
        return friction(Contact(v, 0.63, vanes(pressure, angle)), Bristle(z), 0.0)[0]

    at = (velocity, deflection, np.array(LOAD), 2e5, 15.0)
    slopes = jax.grad(force, argnums=range(5))(*map(jnp.asarray, at))
    for place, (slope, size) in enumerate(zip(slopes, (1e-8, 1e-9, 1e-3, 1.0, 1e-4), strict=True)):
        for index, step in enumerate(size * np.eye(np.size(slope))):
            shift = step.reshape(np.shape(at[place]))
            ends = [force(*at[:place], at[place] + side * shift, *at[place + 1 :]) for side in (1, -1)]
            difference = float(ends[0] - ends[1]) / (2 * size)
            # Steps of the Stribeck curve's 1e-5, whose curvature is left; slopes with respect to the load are forces
            # below 1 N.
            assert np.ravel(slope)[index] == pytest.approx(difference, rel=1e-4, abs=1e-9)
    # By hand: bristles at rest carry their dampers' sum, and theta of it.
    theta = float(FRICTION.theta(vanes(2e5, 15.0)))
    if deflection == 0.0:
        assert slopes[0] == pytest.approx(theta * (429.77 + 206.0), rel=1e-9)
        assert slopes[1] == pytest.approx(theta * 43135.0, rel=1e-6)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"load": [1.0] * 9},
            "friction.load needs 10 numbers, one for each turbine pressure and crank angle, but it has 9; give 2 rows",
        ),
        ({"load": [-1.0] * 10}, "'friction.load' must be finite and not negative, but it is -1; correct it"),
        (
            {"crank_angle": [4.0, 12.0, 12.0, 28.0, 36.0]},
            r"friction.crank_angle must be at least two knots that increase, in deg, but it is \[4.0, 12.0, 12.0,",
        ),
        (
            {"turbine_pressure": [0.0, 3e5]},
            "friction.turbine_pressure must be at least two knots that increase, in Pa gauge from above zero, but it",
        ),
    ],
)
def test_a_table_that_does_not_fit_is_refused(fields, message):
    with pytest.raises(vgtjax.InputError, match=message):
        AdaptiveLuGre(**fields)


def test_a_table_read_at_other_knots_is_the_same_friction():
    finer = FRICTION.on_knots([0.75e5, 1.5e5, 3e5], np.linspace(4.0, 36.0, 9))
    assert finer.load.size == 27
    for pressure in (0.3e5, 2e5, 4e5):
        for angle in (5.0, 19.0, 40.0):
            expected = float(FRICTION.theta(vanes(pressure, angle)))
            assert finer.theta(vanes(pressure, angle)) == pytest.approx(expected, rel=1e-12)
