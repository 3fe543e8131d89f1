"""A bare mass with friction, perhaps on a spring, pulled by a force: the mechanical model without preload or stops."""

import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.parts import Contact, Vanes


def axis(friction: vgtjax.AbstractFriction, mass: float = 0.63, stiffness: float = 0.0) -> vgtjax.MechanicalActuator:
    """The mass in kg, on a spring in N/m to a point that is at rest, or whose motion is part of the force."""
    return vgtjax.replace_parameters(
        vgtjax.MechanicalActuator(friction=friction),
        {
            "diaphragm.mass": mass,
            "diaphragm.stiffness": stiffness,
            "diaphragm.preload": 0.0,
            "diaphragm.travel": np.inf,
            "diaphragm.stop_stiffness": 0.0,
        },
    )


def pull(time: np.ndarray, force: np.ndarray) -> vgtjax.Trace:
    """A force in N at sample times in s, linear in between, on a mass that starts at rest at zero."""
    return vgtjax.Trace(time=time, f_drive=np.broadcast_to(force, time.shape), x_d=np.zeros_like(time))


def run(friction: vgtjax.AbstractFriction, trace: vgtjax.Trace, step: float = 5e-4, **body: float) -> vgtjax.Solution:
    """Simulates the axis with steps in s."""
    return vgtjax.simulate(axis(friction, **body), trace, stepping=vgtjax.FixedStep(step))


@jax.jit
def drag(
    friction: vgtjax.AbstractFriction, velocity: np.ndarray, duration: np.ndarray, turbine: float = 0.0
) -> tuple[jax.Array, jax.Array]:
    """Force in N at the start of every step, and work in J done on friction over it, where the motion is prescribed.

    Velocity in m/s is constant over each step of a duration in s; turbine pressure in Pa gauge. By the classical
    Runge-Kutta method, so that nothing of the product's integrator takes part.
    """

    def step(state, inputs):
        v, h = inputs
        contact = Contact(v, jnp.asarray(0.63), Vanes(jnp.asarray(5e-3), jnp.asarray(turbine)))

        def rates(state):
            force, rate = friction(contact, state, jnp.zeros_like(v))
            return rate, force * v

        def ahead(rate, by):
            return jax.tree.map(lambda y, k: y + by * k, state, rate)

        one = rates(state)
        two = rates(ahead(one[0], h / 2))
        three = rates(ahead(two[0], h / 2))
        four = rates(ahead(three[0], h))
        rate, power = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, one, two, three, four)
        return ahead(rate, h), (friction(contact, state, jnp.zeros_like(v))[0], h * power)

    return jax.lax.scan(step, friction.initial_state(), (jnp.asarray(velocity), jnp.asarray(duration)))[1]
