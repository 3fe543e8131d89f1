"""What friction is known for: break-away that depends on haste, and rods that stick and slip (Canudas de Wit, 1995)."""

import numpy as np
import pytest
from axis import pull, run

from vgtjax import Coulomb, Dahl, Karnopp, LuGre, PassiveLuGre, replace_parameters

PAPER = replace_parameters(
    LuGre(stribeck_exponent=2),
    {
        "static_force": 1.5,
        "coulomb_force": 1.0,
        "bristle_stiffness": 1e5,
        "bristle_damping": np.sqrt(1e5),
        "viscous_damping": 0.4,
        "stribeck_velocity": 1e-3,
    },
)
"""The parameters of the paper that introduced LuGre friction, which are not passive; its mass is 1 kg."""


def break_away(rate):
    """The largest force of the bristles in N while the pull rises at a rate in N/s."""
    time = np.linspace(0, 4 / rate, 2001)
    # A hundred steps a sample at every rate, 20 us at most: one compilation for all.
    return 1e5 * np.max(run(PAPER, pull(time, rate * time), 2e-5 / rate, mass=1.0).z)


def test_the_faster_the_force_rises_the_earlier_a_rod_breaks_away():
    """The paper's third figure: from near F_s at 1 N/s down to F_c at 50 N/s."""
    forces = [break_away(rate) for rate in (1, 2, 5, 10, 20, 50)]
    assert np.all(np.diff(forces) < -0.02)
    assert 1.4 < forces[0] < 1.5
    assert forces[-1] == pytest.approx(1.0, abs=0.02)


def drawn(friction, speed, stiffness, mass, seconds):
    """Velocity of a mass over drive speed, once it has forgotten its start; a spring in N/m draws it at m/s."""
    time = np.arange(0, seconds, 2e-3)
    moved = run(friction, pull(time, stiffness * speed * time), mass=mass, stiffness=stiffness)
    return np.asarray(moved.v_d)[len(time) // 2 :] / speed


SLIPPING = {
    "the paper's": (PAPER, 2.0, 1.0, 0.1),
    "passive": (PassiveLuGre(bristle_damping=6.0, excess_damping=0.5), 20.0, 0.63, 0.01),
    "Karnopp": (Karnopp(viscous_damping=2.0), 20.0, 0.63, 0.01),
}


@pytest.mark.parametrize("name", SLIPPING)
def test_a_slow_drive_makes_it_stick_and_slip(name):
    friction, stiffness, mass, speed = SLIPPING[name]
    ratio = drawn(friction, speed, stiffness, mass, 40.0)
    stuck = np.abs(ratio) < 0.05
    assert 0.2 < np.mean(stuck) < 0.98
    assert np.sum(np.diff(stuck.astype(int)) == 1) >= 2  # again and again
    assert ratio.max() > 2.5


@pytest.mark.parametrize("name", SLIPPING)
def test_a_fast_drive_makes_it_slide(name):
    friction, stiffness, mass, speed = SLIPPING[name]
    assert drawn(friction, 20 * speed, stiffness, mass, 20.0).min() > 0.5


@pytest.mark.parametrize("friction", [Coulomb(viscous_damping=2.0), Dahl(viscous_damping=2.0)])
def test_nothing_slips_without_stiction(friction):
    ratio = drawn(friction, 0.01, 20.0, 0.63, 40.0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.01)  # what the viscous part has left of the start's swing


def test_the_printed_friction_slides_even_in_creep():
    """Its viscous damping takes off half the fall of the Stribeck curve, its bristles and a stiff spring the rest."""
    np.testing.assert_allclose(drawn(LuGre(), 1e-3, 12e3, 0.63, 4.0), 1.0, atol=1e-3)
