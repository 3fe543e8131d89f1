"""What every design owes: conditions that are checked whenever gains change, and a version for a plant."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.control import (
    LQG,
    PI,
    PID,
    AdaptiveBackstepping,
    Backstepping,
    DesignModel,
    FrictionCompensation,
    Knocker,
    LoadBackstepping,
    PressureObserver,
    Scenario,
    StaticBalance,
    check,
    close_loop,
    signal_1,
    tracking_rms,
)
from vgtjax.plants import FlowMapPath, Plant


@pytest.fixture(scope="module")
def heavy(actuator):
    """Five times the printed mass, and bristles that are damped twice as much."""
    changed = {"diaphragm.mass": 5 * 0.63, "friction.bristle_damping": 2 * 429.77}
    return vgtjax.replace_parameters(actuator, changed)


@pytest.fixture(scope="module")
def model(heavy):
    return DesignModel.for_plant(heavy)


def test_designs_for_a_plant_believe_in_it(heavy, model):
    balance = StaticBalance(heavy.converter, heavy.diaphragm)
    assert eqx.tree_equal(StaticBalance.for_plant(heavy), balance)
    assert eqx.tree_equal(PI.for_plant(heavy), PI(base=balance))
    assert eqx.tree_equal(PID.for_plant(heavy), PID(PI(base=balance)))
    assert eqx.tree_equal(Knocker.for_plant(heavy, amplitude=3.0), Knocker(PI(base=balance), amplitude=3.0))
    assert eqx.tree_equal(model.flow_map, vgtjax.fit_flow_map(heavy, "steady-plunger").flow_map)
    assert float(model.diaphragm.mass) == float(heavy.diaphragm.mass)
    with pytest.raises(vgtjax.InputError, match=r"must have LuGre friction, .* has Coulomb; use LuGre") as info:
        FrictionCompensation.for_plant(vgtjax.Actuator(friction=vgtjax.Coulomb()))
    assert info.value.argument == "plant"


@pytest.mark.parametrize("design", [Backstepping, AdaptiveBackstepping, LoadBackstepping, LQG, PI])
def test_a_plant_of_parts_gets_the_gains_of_the_actuator_of_these(heavy, design):
    parts = Plant(heavy.air_path, heavy.rod, heavy.air)
    assert eqx.tree_equal(design.for_plant(parts), design.for_plant(heavy))


@pytest.mark.parametrize("design", [Backstepping, AdaptiveBackstepping, LQG])
def test_a_plant_with_a_flow_map_of_its_own_is_followed_by_what_is_designed_on_it(design):
    plant = vgtjax.StaticMapActuator()
    controller = design.for_plant(plant)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(controller))
    assert eqx.tree_equal(DesignModel.for_plant(plant).flow_map, plant.flow_map)
    run = close_loop(plant, controller, Scenario(signal_1()), 4.0)
    assert float(tracking_rms(run, settled=1.0)) < 1e-4


def test_a_plant_that_no_flow_map_describes_is_named(heavy):
    with pytest.raises(vgtjax.InputError, match="is made of the full model, an Actuator, but this is a PlungerMapAct"):
        DesignModel.for_plant(vgtjax.PlungerMapActuator())
    with pytest.raises(vgtjax.InputError, match="needs a converter, but Plant has none"):
        PI.for_plant(Plant(air_path=FlowMapPath()))


def test_gains_for_a_plant_keep_their_forces_and_their_conditions(heavy, model):
    """Forces over mass are inverse to it; the bound of the friction rate is inverse to the damping's square."""
    stepping, adaptive = Backstepping.for_plant(heavy, model), AdaptiveBackstepping.for_plant(heavy, model)
    for found, names in (
        (stepping, ("velocity_gain", "pressure_weight")),
        (adaptive, ("load_gain", "pressure_weight")),
    ):
        for name in names:
            assert 5 * float(getattr(found, name)) == pytest.approx(float(getattr(type(found)(), name)), rel=1e-12)
    assert float(stepping.position_gain) == float(Backstepping().position_gain)
    assert float(Backstepping.for_plant(heavy, model, velocity_gain=7.0).velocity_gain) == 7.0
    # The bound is 26.16 1/s over 4 here, above the default of 5 1/s, and over 40 in a model of more damping.
    assert float(stepping.observer.friction_rate) == 5.0
    stiff = eqx.tree_at(lambda m: m.friction.bristle_damping, model, jnp.asarray(40**0.5 * 429.77))
    rate = float(PressureObserver.for_plant(heavy, stiff).friction_rate)
    assert rate in 5.0 / 2.0 ** np.arange(3, 7)
    with pytest.raises(vgtjax.InputError, match=r"must (outweigh|be at most)"):
        PressureObserver(stiff, friction_rate=2 * rate)
    # 63.2 N s/m times five over two is 158: half as much again is above the default of 200.
    compensation = FrictionCompensation.for_plant(heavy)
    assert float(compensation.derivative_gain) == pytest.approx(1.5 * 2.5 * 43135.0 * 0.63 / 429.77)
    assert float(FrictionCompensation.for_plant(vgtjax.Actuator()).derivative_gain) == 200.0


@pytest.mark.parametrize(
    ("design", "name", "value", "sentence"),
    [
        (Knocker(PI()), "width", 0.05, r"width must be below the interval of 0\.04 s"),
        (Knocker(FrictionCompensation()), "controller.derivative_gain", 60.0, "derivative_gain must exceed 63"),
        (Backstepping(), "observer.friction_rate", 27.0, "friction_rate must be at most"),
        (Backstepping(), "velocity_gain", 0.0, r"velocity_gain must be positive, but it is 0\.0; raise it"),
        (AdaptiveBackstepping(), "observer.start", (1.0, 6.0, 1.0), "start of the coefficients .* but it is 6"),
    ],
)
def test_replaced_gains_are_checked_by_the_same_rule(design, name, value, sentence):
    """Also those of a design inside another, which replacing a leaf does not build again."""
    check(design)
    with pytest.raises(vgtjax.InputError, match=sentence):
        check(vgtjax.replace_parameters(design, {name: value}))


def test_inside_jit_nothing_is_checked_and_in_a_batch_everything():
    assert float(jax.jit(lambda gain: FrictionCompensation(derivative_gain=gain).derivative_gain)(1.0)) == 1.0
    batch = Knocker(PI(), width=np.array([0.01, 0.02]), interval=np.array([0.04, 0.04]))
    assert batch.width.shape == (2,)
    with pytest.raises(vgtjax.InputError, match=r"below the interval of 0\.03 s, .* but it is 0\.05"):
        Knocker(PI(), width=np.array([0.01, 0.05]), interval=np.array([0.04, 0.03]))
