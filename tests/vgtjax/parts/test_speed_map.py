"""The map whose sides change over a speed: closed forms, steps, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import forward_mode, rms

import vgtjax
from vgtjax import Actuator, Crank, FixedStep, HysteresisMap, InputError, SpeedMap, jacobian, select, simulate
from vgtjax.experiments import SlowLoop
from vgtjax.parts import Body, Vanes

PRESSURES, ANGLES = np.array([1.5e5, 3.0e5]), np.array([4.0, 10.0, 16.0, 22.0, 28.0, 34.0])
CLOSING = np.outer([1.0, 2.0], np.linspace(2.6, 1.3, 6)).ravel()
OPENING = np.outer([1.0, 1.9], np.linspace(-1.9, -0.8, 6)).ravel()
MAP = SpeedMap(closing=CLOSING, opening=OPENING)
AT = Vanes(jnp.asarray(Crank().opening(16.0)), jnp.asarray(3.0e5))
HALF = 0.5 * (CLOSING[8] - OPENING[8])
"""Of the difference of the tables there, in N."""


def force(law, velocity, vanes=AT):
    return float(law(vanes, jnp.asarray(velocity), None)[0])


def map_with(side_speed):
    return SpeedMap(closing=CLOSING, opening=OPENING, side_speed=side_speed)


def test_steady_vanes_feel_the_tables():
    for row, pressure in enumerate(PRESSURES):
        for column, angle in enumerate(ANGLES):
            at = Vanes(jnp.asarray(Crank().opening(angle)), jnp.asarray(pressure))
            assert force(MAP, 0.1, at) == pytest.approx(CLOSING.reshape(2, 6)[row, column], rel=1e-9)
            assert force(MAP, -0.1, at) == pytest.approx(OPENING.reshape(2, 6)[row, column], rel=1e-9)


@pytest.mark.parametrize("velocity", [-3e-3, -2e-4, 0.0, 1e-3, 0.5])
def test_between_them_the_force_goes_with_the_hyperbolic_tangent(velocity):
    middle = 0.5 * (CLOSING[8] + OPENING[8])
    assert force(MAP, velocity) == pytest.approx(middle + HALF * np.tanh(velocity / 1e-3), rel=1e-12)
    assert force(map_with(1e-9), velocity) == pytest.approx(middle + HALF * np.sign(velocity), rel=1e-12)


@pytest.mark.parametrize("velocity", [-0.1, 0.0, 1e-3])
def test_without_gas_there_is_no_force_and_no_damping(velocity):
    still = Vanes(jnp.asarray(5e-3), jnp.asarray(0.0))
    assert force(MAP, velocity, still) == 0.0
    assert MAP.damping(still, jnp.asarray(velocity)) == 0.0


def test_damping_is_the_slope_at_rest_and_never_less_than_the_derivative():
    slope = jax.vmap(jax.grad(lambda v: MAP(AT, v, None)[0]))
    velocity = jnp.linspace(-5e-3, 5e-3, 101)
    damping = jax.vmap(lambda v: MAP.damping(AT, v))(velocity)
    assert MAP.damping(AT, jnp.asarray(0.0)) == pytest.approx(HALF / 1e-3, rel=1e-12)
    assert MAP.damping(AT, jnp.asarray(0.0)) == pytest.approx(float(slope(jnp.zeros(1))[0]), rel=1e-12)
    assert np.all(damping >= slope(velocity) * (1 - 1e-12))
    crossed = SpeedMap(closing=OPENING, opening=CLOSING)
    np.testing.assert_allclose(jax.vmap(lambda v: crossed.damping(AT, v))(velocity), damping, rtol=1e-12)


def test_damping_relaxes_the_rod():
    rods = [Actuator(vane_force=law).rod for law in (MAP, HysteresisMap(closing=CLOSING, opening=OPENING))]
    body = Body(jnp.asarray(5e-3), jnp.asarray(2e-3))
    rates = []
    for rod in rods:
        state = vgtjax.plants.RodState(body, rod.friction.initial_state(), rod.vane_force.initial_state())
        rates.append(float(rod.relaxation(state, jnp.asarray(3.0e5)).body.velocity))
    at = Vanes(rods[0].diaphragm.travel - body.position, jnp.asarray(3.0e5))
    expected = MAP.damping(at, body.velocity) / rods[0].diaphragm.mass
    assert rates[0] - rates[1] == pytest.approx(float(expected), rel=1e-9)


def hot_loop(seconds=4.0):
    time = np.arange(round(seconds / 1e-2) + 1) * 1e-2
    duty = 100 * (1 - np.abs(2 * time / seconds - 1))
    return vgtjax.Trace(time, pwm=duty, p_res=np.full_like(time, 2.0e4), p_trb=np.full_like(time, 3.0e5), name="loop")


@pytest.mark.parametrize("side_speed", [1e-3, 1e-4, 1e-5])
def test_the_default_step_follows_a_narrow_side(side_speed):
    """Measured on a loop of 12 s: 0.02, 0.04 and 0.1 um RMS; with the derivative as damping 25 um at the narrowest."""
    model, trace = Actuator(vane_force=map_with(side_speed)), hot_loop()
    run, fine = (simulate(model, trace, stepping=FixedStep(max_step=step)) for step in (5e-4, 5e-5))
    assert rms(run.x_d - fine.x_d) < 0.5e-6
    assert float(np.abs(run.x_d - fine.x_d).max()) < 5e-6


def test_batches_of_side_speeds_are_those_one_by_one():
    trace = hot_loop(1.0)

    def position(side_speed):
        return simulate(Actuator(vane_force=map_with(side_speed)), trace, throw=False).x_d

    speeds = jnp.asarray([1e-3, 1e-4])
    together = jax.jit(jax.vmap(position))(speeds)
    np.testing.assert_allclose(together[1], position(speeds[1]), atol=1e-12)


FREE = ["vane_force.side_speed", "vane_force.closing[8]", "vane_force.opening[8]"]


@pytest.mark.parametrize("side_speed", [1e-3, 1e-4])
def test_gradients_are_central_differences(side_speed):
    """Position and pressure along a loop under gas, at the default step."""
    model = Actuator(vane_force=map_with(side_speed))
    time = np.arange(400) * 2e-3
    duty = np.interp(time, [0.0, 0.3, 0.5, 0.8], [20.0, 80.0, 45.0, 60.0])
    still = np.zeros_like(time)
    trace = vgtjax.Trace(
        time, pwm=duty, p_res=still + 2.0e4, p_trb=still + 2.4e5, x_d=still, p_act=still + 101013.0, name="gassed"
    )
    selection = select(model, free=FREE)
    theta = np.asarray(selection.pack(model))
    columns = np.asarray(jacobian(model, [trace], free=FREE)[0])

    def observed(values):
        run = simulate(selection.unpack(model, values), trace, throw=False)
        return jnp.stack([run.x_d, run.p_act], axis=1)

    np.testing.assert_allclose(columns, forward_mode(observed, theta), rtol=1e-7, atol=1e-9 * np.abs(columns).max())
    size = 1e-6 * np.abs(theta)
    shifts = np.concatenate([theta + np.diag(size), theta - np.diag(size)])
    up, down = np.split(np.asarray(jax.jit(jax.vmap(observed))(shifts)), 2)
    difference = np.moveaxis((up - down) / (2 * size)[:, None, None], 0, -1)
    for index, entry in enumerate(selection.entries):
        for channel in range(2):
            exact, expected = columns[:, channel, index], difference[:, channel, index]
            assert np.linalg.norm(expected) > 0, f"{entry} is dead"
            assert np.linalg.norm(exact - expected) <= 1e-3 * np.linalg.norm(expected), (entry, channel)


def test_a_fast_loop_is_as_wide_as_that_of_the_hysteresis_map():
    """Both end on the same tables; over 8 mm in a second the rod is far above the side speed."""
    loop = SlowLoop((0.0, 3.0e5), 4.0)
    nominal = Actuator(vane_force=SpeedMap(closing=CLOSING, opening=OPENING, side_speed=1e-4))
    other = Actuator(vane_force=HysteresisMap(closing=CLOSING, opening=OPENING))
    widths = []
    for model in (nominal, other):
        population = vgtjax.population.spread_population(model, relative=0.01, vary=["diaphragm.stiffness"])
        evaluator = vgtjax.population.Evaluator(model, population.factors, [loop], lanes=1)
        widths.append(evaluator(population.nominal[None])["hysteresis_3000mbar"][0])
    assert widths[0] == pytest.approx(widths[1], abs=20.0)  # Pa of some 4,600


def test_tables_move_to_other_knots_and_bad_values_are_refused():
    moved = MAP.on_knots([3.0e5], [4.0, 16.0])
    assert moved.closing.shape == (2,)
    assert force(moved, 0.1) == pytest.approx(force(MAP, 0.1), rel=1e-12)
    with pytest.raises(InputError, match=r"vane_force.opening needs 12 numbers, .* it has 5"):
        SpeedMap(opening=np.zeros(5))
    with pytest.raises(InputError, match=r"'vane_force.side_speed' must be finite and above 0"):
        SpeedMap(side_speed=-1e-3)
