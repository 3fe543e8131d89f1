"""Geometry of the nozzle, its moment on a vane, and losses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.turbine import (
    VANES,
    WHEEL,
    AinleyMathieson,
    Angles,
    Blading,
    Gas,
    GivenLoss,
    Losses,
    Nozzle,
    Rotor,
    Soderberg,
    steady,
)
from vgtjax.turbine._losses import energy_loss

from .ducts import solve

BLADING = Blading(0.01, 0.0146, 0.0065, 0.0029)


def test_throat_and_radii():
    """By the triangles of pivot, edge and axis."""
    nozzle, angle = Nozzle(), np.radians(30.0)
    trailing = 25.5e-3 * np.array([0.0, 1.0]) - 7.6e-3 * np.array([np.cos(angle), np.sin(angle)])
    assert float(nozzle.trailing_radius(angle)) == pytest.approx(np.hypot(*trailing), rel=1e-12)
    leading = 25.5e-3 * np.array([0.0, 1.0]) + 7.0e-3 * np.array([np.cos(angle), np.sin(angle)])
    assert float(nozzle.leading_radius(angle)) == pytest.approx(np.hypot(*leading), rel=1e-12)
    widths = [float(nozzle.throat(np.radians(degrees))) for degrees in (4, 10, 30, 50)]
    assert widths == sorted(widths)
    assert 0.5e-3 < widths[0] < 0.7e-3


def test_cells_are_shared_out():
    passage = Nozzle().passage(0.5, 9000.0, 224)
    assert [int(np.sum(np.asarray(passage.row) == number)) for number in (1, 2)] == [64, 88]
    assert np.all(np.diff(passage.m) > 0)
    with pytest.raises(vgtjax.InputError, match="at least 28 cells, but it has 10; take 112 or more"):
        Nozzle().passage(0.5, 9000.0, 10)


def test_a_row_loses_what_its_coefficient_says():
    """Friction is shared out over the row by incompressible flow; at a small pressure difference that is what it is."""
    nozzle, gas = Nozzle(), Gas()
    passage = nozzle.passage(np.radians(30.0), 0.0, 224)
    flow = solve(passage, nozzle.inlet(1.06e5, 900.0), 1.05e5, gas)
    entropy = gas.constant * (np.log(flow.pressure) - gas.gamma * np.log(flow.density)) / (gas.gamma - 1)
    lost = float(flow.temperature[100] * (entropy[100] - entropy[10]))
    behind = 0.5 * float(flow.v_m[96] ** 2 + flow.v_u[96] ** 2)
    # Gas follows the vanes only after their loading length, and is not incompressible.
    assert lost / behind == pytest.approx(0.08, rel=0.1)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"thickness": 6e-3}, "have no throat"),
        ({"volute_radius": 26e-3}, "reach into the volute"),
        ({"trail": 14e-3}, "have no throat|reach into the wheel"),
        ({"vanes": 2}, "must be at least 3"),
        ({"height": 0.0}, "nozzle.height must be a positive size, but it is 0"),
        ({"lead": -1e-3}, "nozzle.lead must be a positive size, but it is -0.001"),
    ],
)
def test_geometry_that_does_not_work(changes, sentence):
    with pytest.raises(vgtjax.InputError, match=sentence):
        Nozzle(**changes).passage(np.radians(10.0), 9000.0)


@jax.jit
@jax.vmap
def through(thickness, vane_angle):
    """Flow through vanes of a thickness that is traced, its slope with respect to that, and whether it was found; of
    three side by side, always, so that one program does for all."""

    def flow(thickness):
        nozzle = Nozzle(thickness=thickness)
        passage = nozzle.passage(vane_angle, 9000.0, 28)
        flow = steady(passage, nozzle.inlet(2e5, 900.0), 1.05e5, Gas())
        return flow.mass_flow, flow.converged

    return jax.jvp(flow, (thickness,), (jnp.ones_like(thickness),), has_aux=True)


def test_no_flow_is_found_through_a_throat_that_is_closed_while_it_is_traced():
    """Its cosine is clipped, so that some flow would be found otherwise; its neighbours in a batch don't notice."""
    thickness, open_ = np.array([0.3e-3, 6e-3, 0.5e-3]), np.full(3, 0.3)
    flow, slopes, found = through(thickness, open_)
    assert found.tolist() == [True, False, True]
    for lane in (0, 2):
        less, alone, more = through(thickness[lane] * np.array([0.999, 1.0, 1.001]), open_)[0]
        # Lanes take other steps to the same states, balanced to 1e-11, whose differences are 1e-9 of the flow.
        assert float(flow[lane]) == pytest.approx(float(alone), rel=1e-9)
        difference = (more - less) / (0.002 * thickness[lane])
        # Of second order: 1e-6, and what flows are balanced to.
        assert float(slopes[lane]) == pytest.approx(float(difference), rel=1e-5)
    angles = np.array([0.3, -0.01, 1.3])  # open, beyond the tangent, into the wheel
    assert through(np.full(3, 0.3e-3), angles)[2].tolist() == [True, False, False]


def test_given_and_soderberg():
    angles = Angles(np.asarray(0.0), np.asarray(70.0))
    assert float(GivenLoss(0.1).coefficient(angles, BLADING, Gas())) == 0.1
    assert float(Soderberg().coefficient(angles, BLADING, Gas())) == pytest.approx(0.04 + 0.06 * 0.49)
    with pytest.raises(vgtjax.InputError, match="from 0 to 120 deg for Soderberg's correlation, but it is 140"):
        Soderberg().coefficient(Angles(np.asarray(70.0), np.asarray(-70.0)), BLADING, Gas())


def test_ainley_and_mathieson():
    """Aungier's fit of the nozzle row's curve, by hand at an outlet angle of 70 deg and a pitch of 0.7."""
    blading = Blading(0.7, 1.0, 0.5, 0.2)
    b, pitch = 20.0, 0.7
    off = pitch - (0.46 + b / 77)
    by_hand = 0.025 + (27 - b) / 530 + (0.1583 - b / 1640) * off**2 + 0.08 * ((b / 30) ** 2 - 1) * off**3
    angles = Angles(np.asarray(0.0), np.asarray(70.0))
    assert float(AinleyMathieson().profile(angles, blading)) == pytest.approx(by_hand, rel=1e-9)
    # More loss with a gap than without, and with an impulse row than with a nozzle row.
    tight, gap = (AinleyMathieson(clearance=k).coefficient(angles, blading, Gas()) for k in (0.0, 0.01))
    assert float(gap) > float(tight) > by_hand
    with pytest.raises(vgtjax.InputError, match="from 40 to 80 deg for Ainley and Mathieson's correlation"):
        AinleyMathieson().coefficient(Angles(np.asarray(0.0), np.asarray(85.0)), blading, Gas())


def test_losses_of_walls_by_hand():
    """(3.65) to (3.67): signed angles, and the mean angle by the mean of tangents, which is not printed. Walls: Dunham
    and Came, with the annulus at the inlet of a row as wide as behind it."""
    inlet, outlet = -20.0, 65.0
    mean = np.arctan(0.5 * (np.tan(np.radians(inlet)) + np.tan(np.radians(outlet))))
    lift = 2 * (np.tan(np.radians(inlet)) - np.tan(np.radians(outlet))) * np.cos(mean)
    loading = lift**2 * np.cos(np.radians(outlet)) ** 2 / np.cos(mean) ** 3
    narrowed = np.cos(np.radians(outlet)) / np.cos(np.radians(inlet))
    found = AinleyMathieson().secondary(Angles(np.asarray(inlet), np.asarray(outlet)), Blading(0.7, 1.0, 0.5, 0.2))
    assert float(found) == pytest.approx(0.0334 * 2 * narrowed * loading, rel=1e-12)


@pytest.mark.parametrize(
    ("inlet", "outlet", "sizes", "by_hand"),
    [
        # M 0.71974, A 0.0382075, B 0.146105, C -0.0444444, X -0.0197403.
        (0.0, 70.0, (0.7, 0.2), 0.0382648),
        # M 0.524617, A 0.134350, B 0.5, C 0.483776, X 0.175383.
        (-70.0, 70.0, (0.7, 0.2), 0.1471195),
        # A quarter of the way from the first to the second; a quarter more of thickness by the power of one half.
        (-35.0, 70.0, (0.7, 0.2), 0.0654785),
        (35.0, -70.0, (0.7, 0.25), 0.0732072),
        # Above 30 deg from the tangent: M 0.921692, A 0.0207861, B 0.133910, X -0.121692, by the power of 7/3.
        (0.0, 50.0, (0.8, 0.2), 0.0217688),
        # M 0.726469, A 0.0762995, B 0.263636, C 0.238500, X 0.0735309.
        (-50.0, 50.0, (0.8, 0.2), 0.0776301),
    ],
    ids=["nozzle row", "impulse row", "between", "thick", "open nozzle row", "open impulse row"],
)
def test_profile_losses_by_hand(inlet, outlet, sizes, by_hand):
    """Aungier's fits on a pocket calculator, to the digits that are written down."""
    (pitch, thickness), angles = sizes, Angles(np.asarray(inlet), np.asarray(outlet))
    found = AinleyMathieson().profile(angles, Blading(pitch, 1.0, 0.5, thickness))
    assert float(found) == pytest.approx(by_hand, abs=1e-7)


def test_a_row_loses_in_all_what_is_found_by_hand():
    """From -35 to 70 deg at a chord of twice the height and a gap of a hundredth of the chord: mean angle 45.6692 deg,
    lift over pitch 4.81849, `Z = 7.95912`. Walls `0.0334 * 2 * 0.417525 Z = 0.221988`, gap `0.47 * 2 * 0.0275423 Z =
    0.206060`, profile 0.0654785, in all 0.493526; behind it Mach 0.8, where `p/p_0` is 0.665619 and `1.34 * 0.64` is
    0.8576: `2 ln(1 + 0.493526 * 0.334381) / 0.8576 = 0.356211`."""
    angles, blading = Angles(np.asarray(-35.0), np.asarray(70.0)), Blading(0.7, 1.0, 0.5, 0.2)
    law = AinleyMathieson(clearance=0.01, mach_number=0.8)
    assert float(law.secondary(angles, blading)) == pytest.approx(0.221988, abs=1e-6)
    assert float(law.tip(angles, blading)) == pytest.approx(0.206060, abs=1e-6)
    assert float(law.coefficient(angles, blading, Gas())) == pytest.approx(0.356211, abs=2e-6)  # of six digits
    assert float(energy_loss(0.2, 0.8, Gas())) == pytest.approx(0.150968, abs=1e-6)


@pytest.mark.parametrize(("deflection", "by_hand"), [(0.0, 0.04), (50.0, 0.055), (70.0, 0.0694), (120.0, 0.1264)])
def test_soderbergs_losses_by_hand(deflection, by_hand):
    angles = Angles(np.asarray(0.4 * deflection), np.asarray(-0.6 * deflection))
    assert float(Soderberg().coefficient(angles, BLADING, Gas())) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"inlet": 10.0}, "minus inlet over outlet angle of the row must be from 0 to 1 for"),
        ({"inlet": -75.0}, "minus inlet over outlet angle of the row must be from 0 to 1 for"),
        ({"spacing": 0.2}, "pitch over chord of the row must be from 0.3 to 1.1 for"),
        ({"thickness": 0.02}, "thickness over chord of the row must be from 0.15 to 0.25 for"),
        ({"thickness": 0.3}, "thickness over chord of the row must be from 0.15 to 0.25 for"),
    ],
)
def test_blades_that_the_charts_do_not_have(changes, sentence):
    """Refused, or in the profile's loss held at the edge of the charts."""
    row = {"inlet": -30.0, "spacing": 0.7, "thickness": 0.2}
    edge = {"inlet": np.clip(changes.get("inlet", -30.0), -70.0, 0.0), "spacing": 0.3}
    edge["thickness"] = np.clip(changes.get("thickness", 0.2), 0.15, 0.25)

    def made(inlet, spacing, thickness):
        return Angles(np.asarray(inlet), np.asarray(70.0)), Blading(spacing, 1.0, 0.5, thickness)

    beyond, at_edge = made(**row | changes), made(**row | {name: edge[name] for name in changes})
    with pytest.raises(vgtjax.InputError, match=f"^{sentence} Ainley and Mathieson's correlation, but it is"):
        AinleyMathieson().coefficient(*beyond, Gas())
    held, there = (AinleyMathieson(hold=True).profile(*each) for each in (beyond, at_edge))
    assert float(held) == pytest.approx(float(there), rel=1e-12)
    assert not bool(AinleyMathieson().valid(*beyond))
    assert bool(AinleyMathieson().valid(*at_edge))
    assert bool(AinleyMathieson(hold=True).valid(*beyond))


def test_an_angle_that_the_charts_do_not_have_is_held_at_its_edge_in_all_losses():
    law = AinleyMathieson(hold=True, clearance=0.01)
    sizes = Blading(0.7, 1.0, 0.5, 0.2)
    for sign in (1.0, -1.0):
        beyond, edge = (
            law.coefficient(Angles(np.asarray(0.0), np.asarray(sign * angle)), sizes, Gas()) for angle in (86.0, 80.0)
        )
        assert float(beyond) == float(edge)


@pytest.mark.parametrize(
    ("losses", "sentence"),
    [
        ({"vanes": AinleyMathieson()}, "the outlet angle of the vanes at 4 deg must be from 40 to 80 deg for Ainley"),
        ({"rotor": AinleyMathieson()}, "thickness over chord of the wheel must be from 0.15 to 0.25 for Ainley and"),
    ],
)
def test_losses_are_checked_of_both_rows_where_the_vanes_stand(losses, sentence):
    with pytest.raises(vgtjax.InputError, match=f"^{sentence}.*hold the law at its edges"):
        Nozzle(losses=Losses(**losses)).passage(np.radians(4.0), 9000.0)
    law = AinleyMathieson(hold=True)
    nozzle = Nozzle(losses=Losses(**dict.fromkeys(losses, law)))
    passage = nozzle.passage(np.radians(4.0), 9000.0)
    number, (angles, sizes) = (
        (VANES, nozzle._vane_row(np.radians(4.0))) if "vanes" in losses else (WHEEL, nozzle._wheel_row())
    )
    at_edge = np.sign(angles.outlet) * np.clip(np.abs(angles.outlet), *law.OUTLET)
    thickness = sizes.chord * np.clip(sizes.thickness / sizes.chord, *law.THICKNESS)
    edge = Angles(angles.inlet, at_edge), Blading(sizes.spacing, sizes.chord, sizes.height, thickness)
    inside, area = np.asarray(passage.row) == number, 0.5 * np.asarray(passage.area[1:] + passage.area[:-1])
    dynamic = np.asarray(1 + passage.tangent**2) / area**2  # of incompressible flow, along the blades
    along = np.diff(passage.m) * np.sqrt(1 + np.asarray(passage.tangent) ** 2)
    lost = np.sum((np.asarray(passage.friction) * dynamic * along)[inside]) / dynamic[inside][-1]
    assert lost == pytest.approx(float(law.coefficient(*edge, Gas())), rel=1e-12)


def test_vanes_that_gas_meets_with_swirl_lie_outside_at_every_angle():
    """Thick and short enough, and where their outlet angle is in range: gas that is turned to less swirl of the same
    sign is in no chart, so that their profile loss is held at that of a nozzle row."""
    sentence = "minus inlet over outlet angle of the vanes at 25 deg must be from 0 to 1 .* but it is -0.6"
    sizes = {"thickness": 3e-3, "trail": 6e-3}
    with pytest.raises(vgtjax.InputError, match=f"^{sentence}.*hold the law at its edges"):
        Nozzle(**sizes, losses=Losses(vanes=AinleyMathieson())).passage(np.radians(25.0), 9000.0)
    angles, blading = Nozzle(**sizes)._vane_row(np.radians(25.0))
    straight = Angles(0 * angles.inlet, angles.outlet)
    held, there = (AinleyMathieson(hold=True).profile(each, blading) for each in (angles, straight))
    assert float(held) == float(there)
    degrees = np.array([4.0, 20.0, 54.0])
    angles, _ = Nozzle()._vane_row(np.radians(degrees))
    ratio = np.asarray(AinleyMathieson().ratio(angles))
    assert np.all((ratio < -0.7) & (ratio > -0.9))  # of the default ones


def test_a_law_beyond_its_range_fails_where_it_is_traced():
    """Of a wheel that gas leaves at 70 deg, and at 85 deg."""

    @jax.jit
    @jax.vmap
    def works(angle):
        held = Losses(rotor=AinleyMathieson())
        return Nozzle(thickness=3e-3, rotor=Rotor(outlet_angle=angle), trail=6e-3, losses=held).works(0.5)

    assert works(jnp.array([-70.0, -85.0])).tolist() == [True, False]


def test_the_wheel_has_blades_of_its_own():
    """Its pitch is that of its blades; Ainley and Mathieson's loss depends on it, a number of vanes does not matter."""
    held = Losses(rotor=AinleyMathieson(hold=True))
    friction = [
        float(Nozzle(vanes=vanes, rotor=Rotor(blades=blades), losses=held).passage(0.5, 9000.0).friction[150])
        for vanes, blades in ((11, 9), (12, 9), (11, 12))
    ]
    assert friction[0] == friction[1]
    assert abs(friction[2] / friction[0] - 1) > 0.01
    with pytest.raises(vgtjax.InputError, match=r"rotor.blades must be at least 3, but it is 2; give the number"):
        Rotor(blades=2)


def test_energy_loss_of_slow_gas_is_its_pressure_loss():
    # To first order in the square of the Mach number, here 1e-4.
    assert float(energy_loss(0.2, 0.01, Gas())) == pytest.approx(0.2, rel=1e-4)
    assert float(energy_loss(0.2, 0.8, Gas())) < 0.2


def test_energy_loss_is_the_entropy_of_a_loss_of_total_pressure():
    """(3.55) is for a loss over the total pressure before the row; (3.60) to (3.65) give it over the dynamic pressure
    behind: `p_01 / p_02 = 1 + Y (1 - p_2 / p_02)`, whose entropy is that of the coefficient's `zeta W_2^2 / 2`."""
    lost, mach, gas, temperature, total = 0.2, 0.8, Gas(), 800.0, 2e5
    pressure = total * (1 + 0.17 * mach**2) ** (-1.34 / 0.34)
    before = total + lost * (total - pressure)
    entropy = -287.0 * np.log(1 - (before - total) / before)
    behind = 0.5 * mach**2 * 1.34 * 287.0 * temperature
    assert float(energy_loss(lost, mach, gas)) * behind == pytest.approx(temperature * entropy, rel=1e-12)
    assert entropy < -0.5 * 287.0 * np.log(1 - lost)  # with Y for the share it is more than twice as much
