"""Parts compose: any air path with any rod is a plant that simulates, fits and is in every table."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax.plants import AbstractAirPath, AirPath, Plant, Rod, assemble

TRACE = duty_trace((0, 0.03), (80, 0.2), (30, 0.1), p_res=2.0e4)


def test_a_new_actuator_is_put_together_from_parts():
    """It is the actuator with the same parts, to the last place."""
    plant = Plant(
        air_path=AirPath(line=vgtjax.DelayLine(), chamber=vgtjax.WallChamber(wall_conductance=0.2)),
        rod=Rod(friction=vgtjax.Dahl(), diaphragm=vgtjax.Diaphragm(stiffness=13000.0)),
    )
    actuator = vgtjax.Actuator(
        line=vgtjax.DelayLine(),
        chamber=vgtjax.WallChamber(wall_conductance=0.2),
        diaphragm=vgtjax.Diaphragm(stiffness=13000.0),
        friction=vgtjax.Dahl(),
    )
    ours, theirs = vgtjax.simulate(plant, TRACE), vgtjax.simulate(actuator, TRACE)
    np.testing.assert_array_equal(ours.x_d, theirs.x_d)
    assert list(vgtjax.parameter_table(plant)) == list(vgtjax.parameter_table(actuator))


class Syringe(AbstractAirPath):
    """Pressure that follows the duty with a lag: ten lines of physics, the rest of a plant is there."""

    lag: jax.Array = vgtjax.parameter(0.05, symbol="T", unit="s", source="toy")
    chamber: vgtjax.AbstractChamber = eqx.field(default_factory=vgtjax.IsothermalChamber)

    def working_pressure(self, air, drive):
        return air.pressure - 600.0 * drive.pwm

    def start(self, air, pressure, drive):
        return pressure

    def pressure(self, state):
        return state

    def rates(self, air, time, state, drive, displaced, displacement_rate):
        return (self.working_pressure(air, drive) - state) / self.lag

    def relaxation(self, air, state, displaced):
        return 1 / self.lag

    def signals(self, air, state, drive):
        return {"p_act": state}

    def typical_state(self, air):
        return air.pressure

    @property
    def longest_step(self):
        return float("inf")


def test_an_air_path_of_ones_own_takes_part_in_everything():
    plant = Plant(air_path=Syringe())
    run = vgtjax.simulate(plant, TRACE)
    decay = np.exp(-(TRACE.time[30:230] - TRACE.time[30]) / 0.05)
    # Heun's steps of 0.5 ms leave (h / T)^2 / 6 of the step of 48 kPa, 0.8 Pa.
    np.testing.assert_allclose(run.p_act[30:230], 101013.0 - 48e3 * (1 - decay), rtol=0, atol=1.0)
    assert "lag" in vgtjax.parameter_table(plant)
    slopes = vgtjax.jacobian(plant, [TRACE], free=["lag"])[0][:, 1, 0]
    pressures = [vgtjax.simulate(Plant(air_path=Syringe(lag=0.05 + step)), TRACE).p_act for step in (-1e-6, 1e-6)]
    np.testing.assert_allclose(slopes, (pressures[1] - pressures[0]) / 2e-6, rtol=0, atol=1e-4 * np.abs(slopes).max())


def test_parts_are_replaced_by_name():
    actuator = vgtjax.Actuator(diaphragm=vgtjax.Diaphragm(stiffness=13000.0))
    other = assemble(actuator, friction=vgtjax.Coulomb(), line=None)
    assert isinstance(other.friction, vgtjax.Coulomb)
    assert other.diaphragm is actuator.diaphragm
    assert other.line is actuator.line


@pytest.mark.parametrize("part", ["converter", "line", "chamber", "diaphragm", "friction", "vane_force"])
def test_a_part_can_be_reached_and_replaced_in_the_tree(part):
    actuator = vgtjax.Actuator()
    doubled = eqx.tree_at(
        lambda m: getattr(m, part), actuator, replace_fn=lambda node: jax.tree.map(jnp.add, node, node)
    )
    before, after = (jax.tree.leaves(getattr(model, part)) for model in (actuator, doubled))
    assert [float(jnp.sum(leaf)) for leaf in after] == [2 * float(jnp.sum(leaf)) for leaf in before]


def test_a_stiffer_spring_travels_less_whatever_moves_it():
    soft, stiff = (
        vgtjax.simulate(Plant(air_path=Syringe(), rod=Rod(diaphragm=vgtjax.Diaphragm(stiffness=k))), TRACE)
        for k in (12000.0, 15000.0)
    )
    assert rms(soft.x_d) > rms(stiff.x_d)
