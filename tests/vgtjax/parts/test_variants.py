"""A variant is one class on an interface: toys with states and parameters of their own, in no other file."""

import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax import AdaptiveStep, jacobian, parameter, simulate
from vgtjax.parts import Flow

TRACE = duty_trace((0, 0.05), (80, 0.4), (30, 0.3), p_res=2.0e4)


class LaggingVanes(vgtjax.AbstractVaneForce):
    """Turbine pressure on an area, felt after a lag."""

    area: jnp.ndarray = parameter(1e-4, symbol="A", unit="m2", source="toy")
    rate: jnp.ndarray = parameter(50.0, symbol="a", unit="1/s", source="toy")

    def initial_state(self):
        return jnp.zeros_like(self.area)

    def __call__(self, vanes, velocity, state):
        return state, self.rate * (self.steady_force(vanes, velocity) - state)

    def steady_force(self, vanes, velocity):
        return self.area * vanes.turbine_pressure * vanes.opening / 10e-3

    def relaxation(self, vanes, velocity, state):
        return self.rate

    def signals(self, vanes, velocity, state):
        return {"f_vane": state}

    def typical_state(self):
        return jnp.asarray(10.0)


class LaggingLine(vgtjax.AbstractLine):
    """Flow that arrives late by a first-order lag."""

    rate: jnp.ndarray = parameter(300.0, symbol="b", unit="1/s", source="toy")

    def initial_state(self, air, gas):
        return jnp.zeros_like(self.rate)

    def port(self, air, state, gas, flow):
        return gas, flow(gas)

    def __call__(self, air, state, entering, gas):
        return Flow(state, entering.temperature), self.rate * (entering.mass_flow - state)

    def relaxation(self, air, state, gas):
        return self.rate

    @property
    def longest_step(self):
        return 1e-3

    def signals(self, state, inflow):
        return {"m_dot_line": inflow.mass_flow}

    def typical_state(self, gas):
        return jnp.asarray(1e-4)


def pushed(pressure):
    return vgtjax.Trace(time=TRACE.time, pwm=TRACE.pwm, p_res=TRACE.p_res, p_trb=np.full_like(TRACE.time, pressure))


@pytest.mark.parametrize(
    ("model", "names"),
    [
        (vgtjax.Actuator(vane_force=LaggingVanes()), ["vane_force.area", "vane_force.rate"]),
        (vgtjax.Actuator(line=LaggingLine()), ["line.rate"]),
    ],
)
def test_a_variant_takes_part_in_everything(model, names):
    trace = pushed(1.5e5)
    run = simulate(model, trace)
    assert rms(run.x_d - simulate(vgtjax.Actuator(), trace).x_d) > 1e-5
    assert rms(simulate(model, trace, stepping=AdaptiveStep()).x_d - run.x_d) < 1e-6
    table = vgtjax.parameter_table(model)
    assert set(names) <= set(table)
    columns = jacobian(model, [trace], free=names)[0]
    assert np.all(np.linalg.norm(columns, axis=(0, 1)) > 0)


def test_vanes_push_the_rod_back_under_turbine_pressure():
    model = vgtjax.Actuator(vane_force=LaggingVanes())
    assert simulate(model, pushed(3e5)).x_d.max() < simulate(model, pushed(0.0)).x_d.max()
    assert simulate(model, pushed(3e5)).f_vane.max() > 10
