"""Lines: dead time, loss, conservation, and no line where they have no length."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import duty_trace, rms

import vgtjax
from vgtjax import Actuator, Air, DelayLine, FixedStep, WaveLine, replace_parameters, simulate
from vgtjax.parts import Flow, GasState, friction_rate, resistance, speed_of_sound

AIR = Air()
SOUND = float(speed_of_sound(AIR))
GAS = GasState(jnp.asarray(8.0e4), jnp.asarray(280.0))
BORE, VISCOSITY = 4e-3, 1.81e-5
TRACE = duty_trace((0, 0.05), (80, 0.5), (30, 0.3), (100, 0.4), (0, 0.4), p_res=2.0e4)
LINES = [DelayLine, WaveLine]
SAME_STEPS = FixedStep(max_step=2.5e-4)
"""Shorter than what any line here asks for."""
LEFT = 1.65 - 0.05
"""s; with the twentieth before it as long as `TRACE`, so that what is compiled for that serves."""


def through(line, flow, step=2e-5, gas=GAS):
    """What arrives, and the states, when a flow (kg/s, one value a step) enters a line that ends in a still chamber."""
    flow = jnp.asarray(flow)

    def rates(state, mass_flow):
        return line(AIR, state, Flow(mass_flow, AIR.temperature), gas)

    def advance(state, flows):
        """Heun's method, as in the product; the flow is linear over a step."""
        arriving, slope = rates(state, flows[0])
        euler = jax.tree.map(lambda y, k: y + step * k, state, slope)
        ahead = rates(euler, flows[1])[1]
        after = jax.tree.map(lambda y, k0, k1: y + 0.5 * step * (k0 + k1), state, slope, ahead)
        return after, (arriving.mass_flow, state)

    pairs = jnp.stack([flow[:-1], flow[1:]], axis=1)
    return jax.jit(lambda pairs: jax.lax.scan(advance, line.initial_state(AIR, gas), pairs)[1])(pairs)


def reynolds(mass_flow):
    return 4 * mass_flow / (math.pi * BORE * VISCOSITY)


def test_resistance_is_the_larger_of_laminar_and_blasius():
    """[2.31] and erratum."""
    slow, fast = 500 / reynolds(1.0), 8000 / reynolds(1.0)
    assert resistance(slow, BORE, VISCOSITY) == pytest.approx(32 * VISCOSITY / BORE**2)
    assert resistance(fast, BORE, VISCOSITY) == pytest.approx(0.158 * VISCOSITY / BORE**2 * 8000**0.75)
    assert resistance(-fast, BORE, VISCOSITY) == resistance(fast, BORE, VISCOSITY)
    meeting = (32 / 0.158) ** (4 / 3) / reynolds(1.0)
    around = [float(resistance(meeting * factor, BORE, VISCOSITY)) for factor in (1 - 1e-9, 1 + 1e-9)]
    assert around[0] == pytest.approx(around[1], rel=1e-8)


def test_resistance_has_finite_slopes_without_flow_and_without_viscosity():
    for point in ((0.0, BORE, VISCOSITY), (1e-4, BORE, 0.0), (0.0, BORE, 0.0)):
        value, slopes = jax.value_and_grad(resistance, argnums=(0, 1, 2))(*map(jnp.asarray, point))
        assert np.all(np.isfinite([value, *slopes]))
    assert resistance(1e-4, BORE, 0.0) == 0


@pytest.mark.parametrize(("cells", "error"), [(2, 0.01), (3, 0.0025), (4, 0.0013), (5, 0.0013)])
def test_smooth_flow_arrives_after_the_time_of_sound(cells, error):
    """A pulse of 20 ms, fourteen dead times: more cells, less error."""
    step, pulse = 2e-5, 1e-2
    time = np.arange(0, 0.12, step)
    arriving, _ = through(DelayLine(viscosity=0.0, cells=cells), 1e-4 * np.exp(-(((time - 0.05) / pulse) ** 2)), step)
    late = 1e-4 * np.exp(-(((time[:-1] - 0.05 - 0.5 / SOUND) / pulse) ** 2))
    assert rms(arriving - late) < error * rms(late)


@pytest.mark.parametrize("cells", [2, 3, 4, 5])
def test_a_jump_arrives_about_the_time_of_sound(cells):
    """No dead time: from 0.3 to 1.9 of it, after a dip of 7 % at most, with weights that cancel two digits at most."""
    line, step = DelayLine(viscosity=0.0, cells=cells), 1e-5
    arriving, _ = through(line, np.full(2000, 1.0), step)
    after = np.asarray(arriving)
    times = step * np.arange(len(after)) * SOUND / 0.5
    assert after.min() > -0.07
    assert after.max() < 1.06
    assert 0.3 < times[np.argmax(after > 0.1)] < 0.55
    assert 1.65 < times[np.argmax(after > 0.9)] < 1.9
    assert after[-1] == pytest.approx(1, abs=1e-3)
    assert sum(abs(float(w)) for w in line._weights(jnp.asarray(1.0))) < 250


@pytest.mark.parametrize("length", [0.02, 0.1, 0.25, 0.29, 0.5, 2.0])
def test_the_mean_delay_is_that_of_the_length(length):
    """Also where lags are kept longer than the delay."""
    step = 2e-5
    time = np.arange(0, 0.2, step)
    pulse = np.exp(-(((time - 0.05) / 5e-3) ** 2))
    arriving, _ = through(DelayLine(length=length, viscosity=0.0), pulse, step)
    assert np.sum(arriving) == pytest.approx(np.sum(pulse), rel=1e-6)
    assert np.sum(arriving * time[:-1]) / np.sum(arriving) == pytest.approx(0.05 + length / SOUND, abs=1e-6)


def test_a_wave_arrives_after_the_time_of_sound():
    """At a chamber's constant pressure it is reflected, so twice the flow arrives [2.16, 2.17]."""
    step = 5e-6
    arriving, _ = through(WaveLine(viscosity=0.0, cells=40), np.full(600, 1e-4), step)
    times = step * np.arange(len(arriving)) * SOUND / 0.5
    after = np.asarray(arriving) / 1e-4
    assert abs(after[times < 0.8]).max() < 0.03
    assert times[np.argmax(after > 1)] == pytest.approx(1, abs=0.02)
    assert np.mean(after[(times > 1.3) & (times < 2.0)]) == pytest.approx(2, abs=0.02)


@pytest.mark.parametrize("mass_flow", [2e-4, -2e-4, 1e-5])
@pytest.mark.parametrize("length", [0.5, 0.1])
def test_steady_flow_along_the_wave_line_loses_pressure_not_mass(mass_flow, length):
    """`R_t v L` [2.30]; pressure falls by so little that the density is the chamber's within the tolerance."""
    line = WaveLine(length=length)
    arriving, states = through(line, np.full(40_000, mass_flow))
    last = jax.tree.map(lambda leaf: leaf[-1], states)
    assert float(arriving[-1]) == pytest.approx(mass_flow, rel=1e-6)  # what has not rung off after 0.8 s
    seen, entering = line.port(AIR, last, GAS, lambda into: Flow(jnp.asarray(mass_flow), into.temperature))
    density = GAS.pressure / (AIR.gas_constant * GAS.temperature)
    velocity = mass_flow / (density * math.pi / 4 * BORE**2)
    drop = float(resistance(mass_flow, BORE, VISCOSITY) * velocity * length)
    assert float(entering.mass_flow) == mass_flow
    assert float(seen.pressure - GAS.pressure) == pytest.approx(drop, rel=3 * abs(drop) / 8e4 + 1e-4)


@pytest.mark.parametrize("length", [0.5, 0.1])
def test_a_wave_line_keeps_what_enters_and_does_not_leave(length):
    """[2.17], in any state whatever."""
    rng = np.random.default_rng(2)
    line = WaveLine(length=length, cells=3)
    state = jax.tree.map(
        lambda leaf: leaf * (1 + 0.1 * rng.normal()) + 1e-4 * rng.normal(), line.initial_state(AIR, GAS)
    )
    arriving, rates = line(AIR, state, Flow(jnp.asarray(3e-4), AIR.temperature), GAS)
    assert float(line.stored_mass(AIR, rates)) == pytest.approx(3e-4 - float(arriving.mass_flow), rel=1e-12)


def test_mass_in_line_and_chamber_is_what_flowed_in():
    """Gas law and pressures against the converter's flow, by the trapezoidal rule at 0.1 ms."""
    model = Actuator(line=WaveLine())
    run = simulate(model, duty_trace((0, 0.05), (90, 0.35), (35, 0.3), (0, 0.3), interval=1e-4, p_res=2.0e4))
    gas = run.p_act * model.chamber.gas_volume(2.9224e-3 * run.x_d) / (286.7 * run.T_act)
    net = np.asarray(run.m_dot_in - run.m_dot_out)
    flowed = np.concatenate([[0.0], np.cumsum(0.5 * (net[1:] + net[:-1]) * 1e-4)])
    both = np.asarray(gas + model.line.stored_mass(AIR, run.states.air_path.line))
    assert rms(both - both[0] - flowed) < 2e-4 * np.ptp(both)
    assert rms(gas - gas[0] - flowed) > 2e-2 * np.ptp(both), "the line would not matter"


@pytest.fixture(scope="module")
def plain():
    return simulate(Actuator(), TRACE, stepping=SAME_STEPS)


@pytest.mark.parametrize("kind", LINES)
def test_without_length_it_is_no_line(kind, plain):
    """The same numbers, up to rounding that XLA orders otherwise."""
    run = simulate(Actuator(line=kind(length=0.0)), TRACE, stepping=SAME_STEPS)
    np.testing.assert_allclose(run.p_act, plain.p_act, rtol=1e-9)
    np.testing.assert_allclose(run.x_d, plain.x_d, rtol=0, atol=1e-11)
    np.testing.assert_allclose(run.m_dot_line, plain.m_dot_in - plain.m_dot_out, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", LINES)
def test_the_derivative_by_the_length_is_there_without_length(kind):
    """One-sided: 0.1 mm of line, whose own effect on the derivative is of the order of 1e-4."""
    model = Actuator(line=kind(length=0.0))

    def pressure(length):
        return simulate(replace_parameters(model, {"line.length": length}), TRACE, throw=False).p_act

    def both(length):
        return jax.jvp(pressure, (length,), (jnp.ones_like(length),))

    # One length after the other compiles faster than both side by side.
    values, slopes = map(np.asarray, jax.jit(lambda lengths: jax.lax.map(both, lengths))(jnp.asarray([0.0, 1e-4])))
    slope, difference = slopes[0], (values[1] - values[0]) / 1e-4
    assert rms(slope) > 100
    assert rms(slope - difference) < 2e-3 * rms(slope)


def test_a_short_line_without_loss_is_the_same_either_way(plain):
    """Both effects vanish with the length: what is left is the wave line's own volume and inertia."""

    def effects(length):
        runs = [simulate(Actuator(line=kind(length=length, viscosity=0.0)), TRACE) for kind in LINES]
        return rms(runs[0].p_act - runs[1].p_act), rms(runs[1].p_act - plain.p_act)

    (apart, whole), (half_apart, half_whole) = effects(0.04), effects(0.02)
    assert half_apart == pytest.approx(0.5 * apart, rel=0.1)
    assert half_whole == pytest.approx(0.5 * whole, rel=0.1)
    assert half_apart < 60  # Pa, of 1100 for the line of half a metre


def test_a_share_of_a_longer_line_stands_for_a_short_one(plain):
    """Against a line of 0.1 m that is resolved: a few percent of what that line does."""
    resolved = simulate(Actuator(line=WaveLine(length=0.1, shortest=0.1)), TRACE)
    shared = simulate(Actuator(line=WaveLine(length=0.1)), TRACE)
    assert rms(shared.p_act - resolved.p_act) < 0.04 * rms(resolved.p_act - plain.p_act)


def test_more_cells_converge(plain):
    """Second order in the cell's length, from 0.3 % of what the line does at 2 cells."""
    tight = FixedStep(max_step=5e-5)
    runs = {cells: simulate(Actuator(line=WaveLine(cells=cells)), TRACE, stepping=tight).p_act for cells in (2, 3, 12)}
    errors = [rms(runs[cells] - runs[12]) for cells in (2, 3)]
    assert errors[1] < 0.6 * errors[0]
    assert errors[0] < 4e-3 * rms(runs[12] - plain.p_act)


def test_attenuation_loses_5_percent_of_the_evacuation():
    """Erratum 8: 0.5 m of 4 mm, while the chamber empties at Reynolds numbers up to 3700."""
    run = simulate(Actuator(line=DelayLine()), duty_trace((0, 0.05), (100, LEFT), p_res=2.0e4))
    begin = slice(300)
    time, out, arriving = (np.asarray(signal)[begin] for signal in (run.time, run.m_dot_out, -run.m_dot_line))
    assert reynolds(out.max()) == pytest.approx(3700, rel=0.03)
    sent = np.interp(time - 0.5 / SOUND, time, out)
    lost = 1 - arriving[80:] / sent[80:]  # after the plunger has moved, the flow changes slowly
    assert np.all((lost > 0.045) & (lost < 0.055))
    expected = (
        0.5 * friction_rate(AIR, GasState(run.p_act[begin], run.T_act[begin]), sent, BORE, VISCOSITY) * 0.5 / SOUND
    )
    np.testing.assert_allclose(lost[20:], 1 - np.exp(-expected[100:]), rtol=0.01)


def time_to(model, drop, duty=80.0):
    run = simulate(model, duty_trace((0, 0.05), (duty, 0.6), p_res=2.0e4, interval=5e-4))
    return float(run.time[np.argmax(101013 - run.p_act > drop)])


@pytest.mark.parametrize("kind", LINES)
def test_a_longer_or_a_narrower_line_is_slower(kind):
    times = [time_to(Actuator(line=kind(length=length)), 4.4e4) for length in (0.1, 0.5, 1.5)]
    assert times[0] < times[1] < times[2]
    assert time_to(Actuator(line=kind(bore=2e-3)), 4.4e4) > times[1]


@pytest.mark.parametrize("kind", LINES)
def test_flow_reverses_when_the_reservoir_loses_its_vacuum(kind):
    trace = duty_trace((0, 0.05), (100, 0.7), (0, LEFT - 0.7), p_res=2.0e4)
    sagging = vgtjax.Trace(time=trace.time, pwm=trace.pwm, p_res=np.where(trace.time < 0.5, 2.0e4, 6.0e4))
    run = simulate(Actuator(line=kind()), sagging)
    assert run.m_dot_line.min() < -1e-4
    assert run.m_dot_line.max() > 1e-4
    assert run.m_dot_out.min() < -1e-5


def test_a_wide_open_valve_between_equal_pressures_does_not_chatter():
    """Flow answers pressure there ten times more steeply than the line: explicit coupling ripples by 200 Pa."""
    run = simulate(Actuator(line=WaveLine()), duty_trace((0, 0.05), (100, LEFT), p_res=6.0e4))
    port = np.asarray(run.states.air_path.line.pressures[0])[450:]
    assert abs(np.diff(port, 2)).max() < 1


def test_lines_refuse_settings_that_are_none():
    with pytest.raises(vgtjax.InputError, match="2 to 5 cells, but 6 are asked for; choose"):
        DelayLine(cells=6)
    with pytest.raises(vgtjax.InputError, match="shortest_lag must be a positive number of seconds, but it is 0"):
        DelayLine(shortest_lag=0)
    with pytest.raises(vgtjax.InputError, match="2 cells or more, but 1 are asked for; choose"):
        WaveLine(cells=1)
    with pytest.raises(vgtjax.InputError, match="shortest must be a positive number of metres, but it is -1"):
        WaveLine(shortest=-1)
