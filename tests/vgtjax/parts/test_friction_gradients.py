"""Derivatives with respect to every parameter of every friction against central differences, solved tight."""

import equinox as eqx
import jax
import numpy as np
import pytest

import vgtjax
from vgtjax import FixedStep, MechanicalActuator, jacobian, select, simulate

MEMBERS = {
    "coulomb": vgtjax.Coulomb(),
    "karnopp": vgtjax.Karnopp(),
    "dahl": vgtjax.Dahl(),
    "dahl, gradual": vgtjax.Dahl(shape_exponent=2.0),
    "dahl, abrupt": vgtjax.Dahl(shape_exponent=0.5),
    "lugre": vgtjax.LuGre(),
    "lugre, squared": vgtjax.LuGre(stribeck_exponent=2),
    "passive": vgtjax.PassiveLuGre(),
    "adaptive": vgtjax.AdaptiveLuGre(
        load=[2.0, 3.0, 4.0, 5.0, 7.0, 9.0], turbine_pressure=[1.0e5, 2.0e5], crank_angle=[12.0, 20.0, 28.0]
    ),
}
CASES = [(name, entry) for name, friction in MEMBERS.items() for entry in select(friction, ["*"]).entries]
TIGHT = FixedStep(max_step=4e-6)
"""Two decades below the default: a step that straddles a kink is differentiated to first order in its length only."""
STEP = 1e-4
"""Relative step of the differences. It moves a kink past many time steps, so that they see what derivatives of single
steps could miss; what hardly moves the rod (`stribeck_velocity`) stands out against the rounding of 6e4 time steps."""
LIMIT = 2e-4
"""Of the norm. Measured: at most 4e-5, of kinks that move past samples; 2e-7 in the median."""


def cycles():
    """Two cycles of 7 mm with small ones on top, while turbine pressure rises: every knot is passed."""
    time = np.arange(0, 0.25, 1e-3)
    force = 110.0 + 50.0 * np.sin(2 * np.pi * 8 * time) + 4.0 * np.sin(2 * np.pi * 40 * time)
    return vgtjax.Trace(time=time, f_drive=force, x_d=np.full_like(time, 5.05e-3), p_trb=1e6 * time)


@pytest.fixture(scope="module")
def slopes():
    """Per member: exact derivatives and central differences of the position, each `(time, parameters)`."""
    return {name: both_ways(friction) for name, friction in MEMBERS.items()}


@eqx.filter_jit
def positions(model, selection, batch):
    """One compilation for every friction of a kind."""

    def position(theta):
        return simulate(selection.unpack(model, theta), cycles(), stepping=TIGHT, throw=False).x_d

    return jax.vmap(position)(batch)


def both_ways(friction):
    model, trace = MechanicalActuator(friction=friction), cycles()
    every = select(model, ["friction.*"])
    exact = jacobian(model, [trace], every.entries, stepping=TIGHT)[0][:, 0]

    theta = np.asarray(every.pack(model))
    size = STEP * np.where(theta == 0, 1.0, np.abs(theta))
    shifted = np.concatenate([theta + np.diag(size), theta - np.diag(size)])
    up, down = np.split(np.asarray(positions(model, every, shifted)), 2)
    return exact, ((up - down) / (2 * size)[:, None]).T


@pytest.mark.parametrize(("name", "entry"), CASES)
def test_the_jacobian_is_the_central_difference(name, entry, slopes):
    index = select(MEMBERS[name], ["*"]).entries.index(entry)
    exact, difference = (columns[:, index] for columns in slopes[name])
    assert np.linalg.norm(exact) > 0, "a dead parameter"
    assert np.linalg.norm(exact - difference) <= LIMIT * np.linalg.norm(difference)
