"""When LuGre friction can generate energy, who says so, and the parameters in which it can't."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from axis import drag
from support import duty_trace

import vgtjax
from vgtjax import AdaptiveLuGre, LuGre, PassiveLuGre, PassivityWarning, replace_parameters

BOUND = 429.77 * 0.4 / 2.8
"""N s/m, of the printed parameters; printed is 206."""
MESSAGE = (
    "friction.viscous_damping must be at least 61.3957 N s/m for passive LuGre friction, but it is 10 and may "
    "generate energy; raise it, lower bristle_damping, or use PassiveLuGre"
)


def test_bound_of_the_printed_parameters():
    assert LuGre().passivity_bound() == pytest.approx(BOUND, rel=1e-12)
    assert LuGre(static_force=2.0, coulomb_force=2.5).passivity_bound() == pytest.approx(429.77 * 0.25, rel=1e-12)


def test_it_is_said_once_in_one_sentence():
    for friction in (LuGre, AdaptiveLuGre):
        with pytest.warns(PassivityWarning, match=MESSAGE) as caught:
            friction(viscous_damping=10.0)
        assert len(caught) == 1


def test_of_a_batch_the_worst_is_named():
    with pytest.warns(PassivityWarning, match=MESSAGE):
        LuGre(viscous_damping=jnp.asarray([206.0, 10.0, 50.0]))


def test_friction_at_its_bound_is_passive():
    """As it is stated: at least so much. Of laws without a bound it always is, of a batch all of them are or not."""
    assert LuGre(viscous_damping=LuGre().passivity_bound()).is_passive
    with pytest.warns(PassivityWarning):
        below = [LuGre(viscous_damping=0.999 * BOUND), LuGre(viscous_damping=np.array([206.0, 10.0]))]
    assert not any(each.is_passive for each in below)
    assert all(law.is_passive for law in (PassiveLuGre(), vgtjax.Dahl(), vgtjax.Coulomb(), AdaptiveLuGre()))


def test_nothing_is_said_of_passive_parameters(recwarn):
    LuGre()
    LuGre(static_force=2.8, viscous_damping=0.0)
    LuGre(viscous_damping=jnp.asarray([62.0, 206.0]))
    assert recwarn.list == []


def test_nothing_is_said_while_tracing():
    dampings = jnp.asarray([1.0, 206.0])
    bounds = jax.jit(jax.vmap(lambda damping: LuGre(viscous_damping=damping).passivity_bound()))(dampings)
    np.testing.assert_allclose(bounds, BOUND, rtol=1e-12)
    assert jax.grad(lambda damping: LuGre(bristle_damping=damping).passivity_bound())(1e3) == pytest.approx(0.4 / 2.8)
    trace = duty_trace((80, 0.01))
    moved = replace_parameters(vgtjax.Actuator(), {"friction.viscous_damping": 1.0})
    vgtjax.simulate(moved, trace)
    jax.jit(lambda: LuGre(viscous_damping=1.0).viscous_damping)()


def random_parameters(seed):
    rng = np.random.default_rng(seed)
    return PassiveLuGre(
        coulomb_force=rng.uniform(0.5, 5.0),
        stribeck_drop=rng.uniform(0.0, 4.0),
        bristle_stiffness=10 ** rng.uniform(4, 5),
        bristle_damping=10 ** rng.uniform(0, 3),
        excess_damping=0.0,
        stribeck_velocity=10 ** rng.uniform(-4, -2),
        stribeck_exponent=int(rng.integers(1, 3)),
    )


@pytest.mark.parametrize("seed", range(6))
def test_passive_friction_dissipates_over_closed_cycles(seed):
    """Parameters on the very bound, and motion between 0.1 mm/s and 10 m/s that returns to its start."""
    friction = random_parameters(seed)
    rng = np.random.default_rng(100 + seed)
    speed = 10 ** rng.uniform(-4, 1, 200) * rng.choice([-1.0, 1.0], 200)
    distance = 10 ** rng.uniform(-6, -3.5, 200)
    back = -np.sum(np.sign(speed) * distance)
    speed, distance = np.append(speed, np.sign(back)), np.append(distance, abs(back))
    duration = np.repeat(distance / np.abs(speed) / 400, 400)
    # Two cycles: over the second one the bristles return to their start as well, so that nothing stored is counted.
    _, work = drag(friction, np.tile(np.repeat(speed, 400), 2), np.tile(duration, 2))
    assert np.all(np.isfinite(work))
    assert np.sum(work[len(duration) :]) > 0


def work_of_a_burst(damping, distance, fast):
    """Work in J over a closed cycle of slow creep, a sudden slip, and slow return."""
    friction = replace_parameters(LuGre(), {"viscous_damping": damping})
    speed = np.array([1e-7, fast, -1e-7])
    # A millimetre of creep stretches the bristles to within 1e-6 of stiction.
    duration = np.repeat(np.array([1e-3, distance, 1e-3 + distance]) / np.abs(speed) / 2000, 2000)
    _, work = drag(friction, np.tile(np.repeat(speed, 2000), 2), np.tile(duration, 2))
    return float(np.sum(work[6000:]))


def test_the_bound_is_sharp():
    """Stiction stretches bristles slowly, a slip unloads them: below the bound that returns more than all else costs.

    The shorter and faster the slip, the closer to the bound: the second is 1/65 of what unloads them, hence within 1 %.
    """
    assert work_of_a_burst(0.0, 1e-6, 100.0) < 0 < work_of_a_burst(206.0, 1e-6, 100.0)
    assert work_of_a_burst(0.97 * BOUND, 1e-6, 1e5) < 0 < work_of_a_burst(BOUND, 1e-6, 1e5)


def test_the_default_is_the_printed_friction():
    ours = PassiveLuGre()
    for name, value in vgtjax.parameter_table(LuGre()).items():
        assert getattr(ours, name) == pytest.approx(value.default, rel=1e-14)
    trace = duty_trace((0, 0.03), (80, 0.1), (20, 0.1), p_res=2.0e4)
    ours = vgtjax.simulate(vgtjax.Actuator(friction=PassiveLuGre()), trace)
    printed = vgtjax.simulate(vgtjax.Actuator(), trace)
    np.testing.assert_allclose(ours.x_d, printed.x_d, rtol=0, atol=1e-15)  # the same numbers but for a last place


def test_both_ends_of_its_domain_are_reached_and_none_is_passed():
    end = PassiveLuGre(stribeck_drop=0.0, excess_damping=0.0)
    assert end.viscous_damping == 0.0
    table = vgtjax.parameter_table(end)
    for name in ("stribeck_drop", "excess_damping"):
        assert not table[name].positive
        assert table[name].lower == 0.0
        with pytest.raises(
            vgtjax.InputError, match=rf"'friction.{name}' must be finite and not negative, but it is -1; correct it"
        ):
            PassiveLuGre(**{name: -1.0})


def test_it_can_be_built_in_a_batch_and_while_tracing():
    batch = eqx.filter_vmap(lambda excess: PassiveLuGre(excess_damping=excess))(jnp.asarray([0.0, 1.0]))
    np.testing.assert_allclose(batch.viscous_damping, BOUND + np.array([0.0, 1.0]), rtol=1e-12)
