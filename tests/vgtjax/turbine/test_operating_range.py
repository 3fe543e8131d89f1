"""The default turbine over its whole range: open, closed, locked and at twice its speed, choked; its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax.parts import Linkage, Stage
from vgtjax.turbine import VANES, Gas, Nozzle, steady, steady_near
from vgtjax.turbine._riemann import pack
from vgtjax.turbine._steady import _Steady

GAS, OUTLET, CELLS = Gas(), 1.05e5, 112
NOZZLE = Nozzle()
VALUES, SHAPE = jax.tree.flatten((NOZZLE, GAS))
NAMES = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path((NOZZLE, GAS))]
STATE = ("vane_angle", "total_pressure", "speed", "outlet_pressure", "total_temperature")
ONES = np.ones(len(VALUES) + len(STATE))


def design_speed(total_pressure):
    """0.6 of the spouting velocity, in rad/s."""
    falling = 2 * GAS.heat_capacity * 900.0 * (1 - (OUTLET / total_pressure) ** (0.34 / 1.34))
    return 0.6 * np.sqrt(falling) / 19e-3


def solve(state, factors, near=None):
    """Passage, flow, moment on a vane, mass flow and power in sizes near one, and the states, with every parameter and
    the state times a factor; searched from states nearby, if there are any."""
    nozzle, gas = jax.tree.unflatten(SHAPE, [value * f for value, f in zip(VALUES, factors, strict=False)])
    angle, pressure, speed, outlet, temperature = state * factors[len(VALUES) :]
    passage = nozzle.passage(angle, speed, CELLS, gas)
    flow, states = steady_near(passage, nozzle.inlet(pressure, temperature), outlet, gas, near)
    moment, _ = nozzle.vane_moment(passage, flow)
    return passage, flow, jnp.stack([moment * 1e2, flow.mass_flow * 10, flow.power / 1e4]), states


solved = jax.jit(solve)
"""The one program of all that is not differentiated."""


def at(vane_angle, total_pressure, speed):
    """Of a point: passage, flow and answers."""
    return solved(np.array([vane_angle, total_pressure, speed, OUTLET, 900.0]), ONES)


@pytest.fixture(scope="module")
def sweep():
    """From no pressure difference to 4.5 bar, a crank of 4 to 37 deg, standing still to twice the design speed."""
    points = [
        (float(Linkage().vane_angle(crank)), pressure, factor * design_speed(pressure))
        for crank in (4.0, 7.0, 15.0, 26.0, 37.0)
        for pressure in (OUTLET, 1.06e5, 2e5, 3e5, 4.5e5)
        for factor in (0.0, 0.5, 1.0, 2.0)
    ]
    passages, flows, *_ = jax.tree.map(lambda *leaves: np.stack(leaves), *[at(*point) for point in points])
    return np.transpose(points), passages, flows


def test_every_point_is_found(sweep):
    points, _, flow = sweep
    missed = np.transpose(points)[~np.asarray(flow.converged)]
    assert missed.tolist() == []
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(flow))


def test_eulers_turbine_equation_holds_everywhere(sweep):
    (_, _, speed), passage, flow = sweep
    row = np.asarray(passage.row[0])
    first, last = np.flatnonzero(row == 2)[[0, -1]]
    swirl = np.asarray(flow.v_u * 0.5 * (passage.radius[:, 1:] + passage.radius[:, :-1]))
    work = flow.mass_flow * speed * (swirl[:, first - 2] - swirl[:, last + 2])
    # Where gas stands still, so does the balance's rounding: watts of 1e4.
    flowing = np.asarray(jnp.abs(flow.mass_flow) > 1e-3)
    np.testing.assert_allclose(flow.power[flowing], work[flowing], rtol=1e-8, atol=1e-6)
    assert np.all(flow.power[np.asarray(speed) == 0.0] == 0.0)  # a locked wheel gives nothing away


def test_more_than_can_be_found_is_said_to_be_not_found():
    """A wheel that pumps so hard against closed vanes that no gas comes through: not converged, and no NaN."""
    _, flow, *_ = at(np.radians(4.0), 1.06e5, 2.5 * design_speed(1.06e5))
    assert not bool(flow.converged)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(flow))


def test_without_a_pressure_difference_gas_rests(sweep):
    (_, pressure, _), _, flow = sweep
    at_rest = np.asarray(pressure == OUTLET)
    assert np.sum(at_rest) == 20
    assert np.max(np.abs(flow.mass_flow[at_rest])) < 1e-5


@jax.jit
def passed_on(nozzle, vane_angle, total_pressure, speed, outlet_pressure):
    """Of 224 cells: `d ln q / d ln p_out`, the Mach number behind the vanes, and the flow."""
    passage = nozzle.passage(vane_angle, speed, 224, GAS)

    def mass_flow(outlet_pressure):
        flow = steady(passage, nozzle.inlet(total_pressure, 900.0), outlet_pressure, GAS)
        return flow.mass_flow, flow

    passing, slope, flow = jax.jvp(mass_flow, (outlet_pressure,), (jnp.ones_like(outlet_pressure),), has_aux=True)
    last = np.flatnonzero(passage.row == VANES)[-1]
    mach = jnp.hypot(flow.v_m, flow.v_u)[last] / GAS.sound_speed(flow.temperature[last])
    return slope * outlet_pressure / passing, mach, flow


@pytest.mark.parametrize("total_pressure", [2.96e5, 3.62e5])
def test_no_cell_flows_back(total_pressure):
    """Searches from the first guess ended where the last cell of closed vanes did, with all cells in balance and a
    moment of the other sign. Moments go smoothly with the pressure: that in the middle of 2 % is the mean to 1e-3."""
    angle, speed = np.radians(4.0), float(Stage().speed_at(jnp.asarray(total_pressure)))
    moments = []
    for share in (0.99, 1.0, 1.01):
        _, _, flow = passed_on(NOZZLE, angle, share * total_pressure, speed, OUTLET)
        assert flow.converged
        assert float(jnp.min(flow.v_m)) > 0
        moments.append(float(NOZZLE.vane_moment(NOZZLE.passage(angle, speed, 224, GAS), flow)[0]))
    assert moments[1] == pytest.approx(0.5 * (moments[0] + moments[2]), rel=1e-3)


def test_cells_that_flow_both_ways_are_no_flow():
    ones, passage = np.ones(CELLS), NOZZLE.passage(0.1, 9000.0, CELLS, GAS)

    def is_flow(velocity, outlet=OUTLET):
        problem = _Steady(passage, NOZZLE.inlet(jnp.asarray(2e5), jnp.asarray(900.0)), jnp.asarray(outlet), GAS)
        return bool(problem.is_flow(pack(ones, velocity, ones, 1e5 * ones)))

    back = np.where(np.arange(CELLS) == 47, -1.0, 50.0)
    assert is_flow(50.0 * ones)
    assert not is_flow(-50.0 * ones)  # a wheel at twice its design speed had one, at 2000 K
    assert is_flow(-50.0 * ones, outlet=2.1e5)
    assert not is_flow(back)
    assert is_flow(1e-3 * back)  # at rest, but for rounding


BESIDE = 4.5 / 112
"""Cells to either side of a shock that are left out, over all."""


def entropies(vane_angle, total_pressure, speed, outlet_pressure):
    """Steps of entropy from cell to cell over the specific gas constant, at 112 and at 224 cells; the angle in deg."""
    angle = np.radians(vane_angle)
    coarse = solved(np.array([angle, total_pressure, speed, outlet_pressure, 900.0]), ONES)[1]
    fine = passed_on(NOZZLE, angle, total_pressure, speed, outlet_pressure)[2]
    assert coarse.converged
    assert fine.converged
    return entropy_steps(coarse), entropy_steps(fine)


def entropy_steps(flow):
    entropy = (np.log(np.asarray(flow.pressure)) - 1.34 * np.log(np.asarray(flow.density))) / 0.34
    return np.diff(entropy)


@pytest.mark.parametrize(
    ("where", "allowed"),
    [
        ((30.0, 2e5, 12000.0, OUTLET), 3e-6),
        ((4.0, 2e5, 17600.0, OUTLET), 5e-4),
        ((45.0, 3e5, 21790.0, 0.6e5), 6e-4),
    ],
    ids=["subsonic", "closed", "sonic exit"],
)
def test_entropy_falls_nowhere_but_by_the_truncation_error(where, allowed):
    """All falls together, over the specific gas constant: 2e-6, 3e-4 and 5e-4 of rises by 0.03 to 0.1 at 112 cells; of
    second order in the volute, and of what a limiter does where rows begin and end."""
    coarse, fine = entropies(*where)
    falls = [-np.sum(np.minimum(steps, 0.0)) for steps in (coarse, fine)]
    assert np.sum(coarse) > 0.02
    assert falls[0] < allowed
    assert falls[1] < 0.4 * falls[0]


@pytest.mark.parametrize("where", [(5.0, 3e5, 12000.0, 0.6e5), (5.0, 3e5, 0.0, OUTLET)], ids=["choked", "locked"])
def test_beside_a_shock_entropy_falls_by_the_truncation_error_too(where):
    """Gas that closed vanes swirl is turned to more than the speed of sound in the wheel, and has a shock there. In the
    cells next to that, whatever their number, it falls by up to 0.5 % of what it rises by; elsewhere falls go to zero.
    """
    falls = []
    for steps in entropies(*where):
        assert np.max(steps) > 0.1
        assert np.min(steps) > -0.006 * np.sum(steps)
        away = np.abs(np.arange(len(steps)) - np.argmax(steps)) > BESIDE * len(steps)
        falls.append(-np.sum(np.minimum(steps[away], 0.0)))
    assert falls[0] < 1e-3  # 8e-4 and 6e-4, of 0.56 and 1
    assert falls[1] < 0.6 * falls[0]


def answers(state, factors):
    """What `solve` says of moment, mass flow and power."""
    return solved(state, factors)[2]


@jax.jit
def both_modes(state, factors):
    """Derivatives of that with respect to all factors: all of them one direction after the other, which compiles in
    half the time, and those of the mass flow in reverse mode."""
    _, along = jax.linearize(lambda factors: solve(state, factors)[2], factors)
    (reverse,) = jax.linear_transpose(along, factors)(jnp.array([0.0, 1.0, 0.0]))
    return jax.lax.map(along, jnp.eye(len(factors))).T, reverse


@jax.jit
def answers_near(state, factors, near):
    """The same, searched from states nearby: a tenth of the time."""
    return solve(state, factors, near)[2]


def slopes(state, factors):
    """Those in forward mode."""
    return both_modes(state, factors)[0]


def state_at(vane_angle, total_pressure, times=1.0):
    """At so many times the design speed; the angle in deg."""
    speed = times * design_speed(total_pressure)
    return np.array([np.radians(vane_angle), total_pressure, speed, OUTLET, 900.0])


CHOKED = np.array([np.radians(5.0), 3e5, 12000.0, 0.6e5, 900.0])
"""At the design speed before 4 bar, as fast as gas is behind the vanes, a sixth of a change of the outlet's pressure
passes: not choked."""


@pytest.mark.parametrize(
    ("state", "passed"),
    [(state_at(5.0, 2e5), (0.1, 1.0)), (state_at(48.0, 2e5), (0.1, 1.0)), (CHOKED, (-0.02, 0.02))],
    ids=["closed", "open", "choked"],
)
def test_derivatives_with_respect_to_every_parameter(state, passed):
    """Of states that are what they are called: how much of a change of the outlet's pressure passes. Of the choked one
    less than 0.02 is asked, either way: 112 cells have its shock in the first two of the wheel, and -0.002 is found."""
    exact, step = np.asarray(slopes(state, ONES)), 1e-4
    outlet = len(VALUES) + STATE.index("outlet_pressure")
    low, high = passed
    _, _, found, near = solved(state, ONES)
    assert low <= -exact[1, outlet] / found[1] < high
    for number, name in enumerate([*NAMES, *STATE]):

        def moved(times, number=number):
            return np.asarray(answers_near(state, ONES + times * step * np.eye(len(ONES))[number], near))

        slope = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * step)
        # Steady states are found to 1e-12, which this step makes 1e-8; beside the largest derivative of all.
        allowed = 1e-6 * np.abs(exact[:, number]) + 1e-8 * np.max(np.abs(exact))
        assert np.all(np.abs(exact[:, number] - slope) <= allowed), name


def test_derivatives_where_the_wheel_turns_too_fast_for_the_first_guess():
    """Continuation finds the state; its derivative knows nothing of the way."""
    state, step = state_at(20.0, 4.5e5, times=2.0), 1e-4
    number = len(VALUES) + STATE.index("speed")
    ahead, behind = (answers(state, ONES + side * step * np.eye(len(ONES))[number]) for side in (1, -1))
    # Central differences: the square of the step, times a third derivative of some ten.
    np.testing.assert_allclose(slopes(state, ONES)[:, number], (ahead - behind) / (2 * step), rtol=1e-5)


def test_a_lane_that_needs_continuation_leaves_the_others_as_they_are():
    states = np.stack([state_at(20.0, 4.5e5, times) for times in (0.0, 1.0, 2.0)])
    _, together, *_ = jax.jit(jax.vmap(lambda state: solve(state, ONES)))(states)
    assert together.converged.tolist() == [True] * 3
    for lane, state in enumerate(states):
        # States are found to 1e-11 of what passes, by whichever order of sums.
        alone = solved(state, ONES)[1].mass_flow
        np.testing.assert_allclose(together.mass_flow[lane], alone, rtol=1e-9)


def test_both_modes_agree():
    forward, reverse = both_modes(state_at(30.0, 2e5), ONES)
    np.testing.assert_allclose(reverse, forward[1], rtol=1e-9, atol=1e-12)  # rounding


@pytest.mark.parametrize(("vane_angle", "speed"), [(5.0, 12000.0), (8.0, 12000.0), (45.0, 21790.0)])
def test_where_a_row_chokes_the_outlet_is_hardly_felt(vane_angle, speed):
    """Gas takes its angle over a length, so a row chokes softly: at most 2 % of a change is passed on."""
    slope, _, flow = passed_on(NOZZLE, np.radians(vane_angle), 3e5, speed, 0.6e5)
    assert flow.converged
    assert abs(float(slope)) < 0.02


@pytest.mark.parametrize(("vane_angle", "rise"), [(5.0, 1.1e-2), (8.0, 0.3e-2), (45.0, 0.1e-2)])
def test_a_row_chokes_as_softly_as_in_another_program(vane_angle, rise):
    """By how much mass flow rises from 1.0 to 0.4 bar behind the wheel; that program has half of the cells and prints
    tenths of a percent."""
    first, last = (
        float(passed_on(NOZZLE, np.radians(vane_angle), 3e5, 12000.0, outlet)[2].mass_flow) for outlet in (1e5, 0.4e5)
    )
    assert last / first - 1 == pytest.approx(rise, abs=1.2e-3)


@pytest.mark.parametrize(("vane_angle", "outlet"), [(5.0, 0.6e5), (5.0, 0.4e5), (8.0, 0.6e5), (8.0, 0.4e5)])
def test_what_a_choked_row_passes_on_is_its_loading_length(vane_angle, outlet):
    """Behind a fast wheel closed vanes are left at Mach 1.1 to 1.4, and up to 7 % of a change passes: in proportion to
    the length over which gas takes the vanes' angle, which is assumed."""
    slopes = []
    for length in (0.08, 0.04):
        slope, mach, flow = passed_on(Nozzle(loading_length=length), np.radians(vane_angle), 3e5, 21790.0, outlet)
        assert flow.converged
        assert float(mach) > 1.0
        slopes.append(float(slope))
    assert -0.07 < slopes[0] < -0.02
    # 0.43 to 0.60: nearly in proportion.
    assert 0.35 < slopes[1] / slopes[0] < 0.65
