"""Adaptive backstepping on its own design model, finely integrated, with its Lyapunov function: for the tests."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax import control
from vgtjax.control import (
    AdaptiveBackstepping,
    AdaptiveEstimate,
    DesignState,
    DualFrictionObserver,
    FrictionEstimate,
    Motion,
)
from vgtjax.control.controllers._adaptive_backstepping import Moment
from vgtjax.control.observers import nominal_coefficients

AMBIENT = jnp.asarray(101_013.0)
WAVE = control.Sine(amplitude=0.003, rate=2.0, offset=0.005)
STEP = 2e-5
"""s. Fourth order is lost where the velocity changes its sign: with 1e-4, `V` rises at one of these."""
SAMPLE = 5e-4
"""s"""

DERIVED = AdaptiveBackstepping(
    position_gain=20.0,
    velocity_gain=150.0,
    pressure_gain=60.0,
    position_weight=400.0,
    pressure_weight=1e-9,
    load_gain=0.0,
    drift_gain=0.0,
    reversal_width=1e-15,
    observer=DualFrictionObserver((0.05, 0.05), adaptation=30.0, largest=5.0, start=(0.7, 1.3, 0.7)),
)
"""The gains of the derivation's example, on top of the damping that is kept, and coefficients 30 % wrong."""
PLAIN = eqx.tree_at(
    lambda c: (c.position_weight, c.pressure_weight, c.pressure_coupling),
    DERIVED,
    (jnp.asarray(0.0), jnp.asarray(1e-8), jnp.asarray(0.0)),
)
"""Without the terms that cancel, as printed."""
BIASED = dataclasses.replace(DERIVED, load_gain=1000.0, drift_gain=400.0)
"""Learns a constant force and a constant error of the flow too."""
CONTROLLERS = {"cancelling": DERIVED, "plain": PLAIN, "biased": BIASED}


class Loop(eqx.Module):
    """The design model and what its controller has learned."""

    plant: DesignState
    estimate: AdaptiveEstimate


class Truth(eqx.Module):
    """What the design model has and the controller does not know: force in N along -x, and flow error in Pa/s."""

    load: jax.Array
    drift: jax.Array


NOTHING = Truth(jnp.asarray(0.0), jnp.asarray(0.0))


def motion(plant):
    return Motion(plant.position, plant.velocity, AMBIENT)


def moment(plant, time):
    return Moment(motion(plant), plant.pressure, control.reference_at(WAVE, time))


def corrected(controller, where, errors, estimate):
    return controller.rates(where, errors, estimate)


def as_printed(controller, where, errors, estimate):
    """[5.69] as printed: the pressure's part of `q` has the other sign in all laws but that of `zh0`."""
    right = controller.rates(where, errors, estimate)
    other = dataclasses.replace(errors, drive=2 * errors.velocity - errors.drive)
    wrong = controller.rates(where, other, estimate)
    deflections = jnp.stack([right.friction.deflections[0], wrong.friction.deflections[1]])
    friction = FrictionEstimate(deflections, wrong.friction.coefficients)
    return dataclasses.replace(right, friction=friction)


def loop_rates(controller, loop, time, truth=NOTHING, law=corrected):
    """Closed loop in continuous time. The pressure gets the rate that is asked for: nothing saturates."""
    plant, where = loop.plant, motion(loop.plant)
    at = moment(plant, time)
    errors = controller.errors(at, loop.estimate)
    learned = law(controller, where, errors, loop.estimate)
    flow = controller.flow(at, loop.estimate, errors, learned)
    # Friction of the plant itself, not of its inverse in the controller.
    body, friction = controller.model.diaphragm, controller.model.friction
    still = jnp.zeros(())
    contact = vgtjax.parts.Contact(plant.velocity, body.mass, vgtjax.parts.Vanes(still, still))
    force, bristle = friction(contact, vgtjax.parts.Bristle(plant.deflection), still)
    pull = (AMBIENT - plant.pressure) * body.area - body.preload - body.stiffness * plant.position
    acceleration = (pull - force - truth.load) / body.mass
    pressure = controller.model.pressure_rate(flow, plant.position, plant.velocity, plant.pressure) + truth.drift
    return Loop(DesignState(plant.velocity, acceleration, bristle.deflection, pressure), learned)


def start_of(controller, position=0.0052, pressure=62_700.0):
    """At rest 0.2 mm from the reference, with the pressure that balances the spring."""
    nothing = jnp.asarray(0.0)
    plant = DesignState(jnp.asarray(position), nothing, nothing, jnp.asarray(pressure))
    return Loop(plant, AdaptiveEstimate(controller.observer.initial_state(controller.model), nothing, nothing))


def lyapunov(controller, loop, time, truth=NOTHING, position_weight=None):
    """`V` of the manual's page on control, with the true bristles and coefficients."""
    model, observer, estimate = controller.model, controller.observer, loop.estimate
    errors = controller.errors(moment(loop.plant, time), estimate)
    beta = nominal_coefficients(model)
    weight = controller.position_weight if position_weight is None else position_weight
    value = weight * errors.position**2 + errors.velocity**2 + controller.pressure_weight * errors.pressure**2
    value += jnp.sum((1 - estimate.friction.coefficients / beta) ** 2) / observer.adaptation
    off = loop.plant.deflection - estimate.friction.deflections
    value += jnp.sum(beta[::2] * off**2 / observer.injection)
    for gain, miss in (
        (controller.load_gain, (truth.load - estimate.load) / model.diaphragm.mass),
        (controller.drift_gain / controller.pressure_weight, truth.drift - estimate.drift),
    ):
        value += jnp.where(gain > 0, miss**2 / jnp.where(gain > 0, gain, 1.0), 0.0)
    return value / 2


def lyapunov_rate(controller, loop, time, position_weight=None):
    """`V'` as derived."""
    model, estimate = controller.model, loop.estimate
    errors = controller.errors(moment(loop.plant, time), estimate)
    weight = controller.position_weight if position_weight is None else position_weight
    off = loop.plant.deflection - estimate.friction.deflections
    h, beta = model.slide(loop.plant.velocity), nominal_coefficients(model)
    a1 = model.diaphragm.area / model.diaphragm.mass
    body = model.diaphragm
    k2 = controller.velocity_gain + body.damping / body.mass + estimate.friction.coefficients[1]
    return (
        -weight * controller.position_gain * errors.position**2
        + (weight - controller.position_weight) * errors.position * errors.velocity
        - k2 * errors.velocity**2
        - (1 - controller.pressure_coupling) * a1 * errors.velocity * errors.pressure
        - controller.pressure_weight * controller.pressure_gain * errors.pressure**2
        - model.friction.bristle_stiffness * h * jnp.sum(beta[::2] * off**2 / controller.observer.injection)
    )


@eqx.filter_jit
def integrate(controller, loop, seconds, truth=NOTHING, law=corrected, position_weight=None):
    """Runge-Kutta of fourth order; the loops and `V` at every sample."""

    def advance(time, loop):
        def at(share, by):
            shifted = jax.tree.map(lambda y, k: y + share * STEP * k, loop, by)
            return loop_rates(controller, shifted, time + share * STEP, truth, law)

        k1 = loop_rates(controller, loop, time, truth, law)
        k2 = at(0.5, k1)
        k3 = at(0.5, k2)
        k4 = at(1.0, k3)
        return jax.tree.map(lambda y, a, b, c, d: y + STEP / 6 * (a + 2 * b + 2 * c + d), loop, k1, k2, k3, k4)

    def sample(loop, index):
        value = lyapunov(controller, loop, index * SAMPLE, truth, position_weight)
        steps = round(SAMPLE / STEP)
        onward = jax.lax.fori_loop(0, steps, lambda i, y: advance(index * SAMPLE + i * STEP, y), loop)
        return onward, (loop, value)

    return jax.lax.scan(sample, loop, jnp.arange(round(seconds / SAMPLE)))[1]


def somewhere(seed, controller):
    """A state in general position, sliding either way."""
    rng = np.random.default_rng(seed)
    plant = DesignState(
        *(jnp.asarray(value) for value in (rng.uniform(0.002, 0.008), rng.normal(0, 0.02), rng.normal(0, 5e-5), 6e4))
    )
    shares = jnp.asarray(rng.uniform(0.5, 2.0, 3))
    friction = FrictionEstimate(jnp.asarray(rng.normal(0, 5e-5, 2)), shares * nominal_coefficients(controller.model))
    load, drift = jnp.asarray(rng.normal(0, 3.0)), jnp.asarray(rng.normal(0, 1e4))
    return Loop(plant, AdaptiveEstimate(friction, load, drift)), jnp.asarray(rng.uniform(0, 3))
