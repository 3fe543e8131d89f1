"""Simulation against independent references, and its behaviour under jit, vmap, precision and failure."""

import dataclasses
import itertools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from support import duty_trace, reference, reference_trace, rms

import vgtjax
from vgtjax import AdaptiveStep, FixedStep, simulate

TABLE = {  # model.md of the independent plant: duty, pressure in Pa, position in m, temperature in K after a long step
    20: (94188, -0.030e-3, 287.4),
    50: (67598, 3.758e-3, 261.6),
    60: (57992, 6.098e-3, 250.5),
    80: (41082, 10.131e-3, 227.1),
    100: (29368, 10.165e-3, 206.5),
}


def errors(name, actuator, **settings):
    """RMS of position in m and of pressure in Pa against the independent plant."""
    states = reference(name)
    solution = simulate(actuator, reference_trace(name), **settings)
    return rms(solution.x_d - states["x_d"]), rms(solution.p_act - states["p_act"])


@pytest.mark.parametrize("name", ["levels", "step_80"])
def test_default_settings_meet_the_reference(name, actuator):
    """The limits are the project's; measured are 0.2 um and 2 Pa."""
    position, pressure = errors(name, actuator)
    assert position <= 2e-6
    assert pressure <= 25.0


@pytest.mark.parametrize("name", ["levels", "step_80"])
def test_errors_fall_as_the_settings_tighten(name, actuator):
    coarse = errors(name, actuator)
    converter = dataclasses.replace(actuator.converter, opening_width=1e-7)
    air = dataclasses.replace(actuator.air, linear_above=0.99999)
    tight = errors(
        name,
        eqx.tree_at(lambda a: (a.converter, a.air), actuator, (converter, air)),
        stepping=FixedStep(max_step=1e-4),
    )
    assert tight[0] < 0.3 * coarse[0]
    assert tight[1] < 0.3 * coarse[1]


@pytest.mark.parametrize(
    ("setting", "widths", "name"),
    [("opening_width", (2e-5, 5e-6, 1e-6, 2e-7), "levels"), ("linear_above", (0.99, 0.999, 0.9999), "step_80")],
)
def test_smoothing_widths_converge(setting, widths, name, actuator):
    """Narrowing a smoothing until the answer stops changing: each width is closer to the hard-switching plant."""
    part = "converter" if setting == "opening_width" else "air"

    def pressure_error(width):
        narrowed = dataclasses.replace(getattr(actuator, part), **{setting: width})
        model = eqx.tree_at(lambda a: getattr(a, part), actuator, narrowed)
        return errors(name, model, stepping=FixedStep(max_step=1e-4))[1]

    found = [pressure_error(width) for width in widths]
    assert all(later < earlier for earlier, later in itertools.pairwise(found))
    assert found[-1] < 2.0  # Pa, a thirtieth of the sensor's noise


@pytest.mark.parametrize("duty", TABLE)
def test_long_steps_end_where_the_independent_plant_ends(duty, actuator):
    solution = simulate(actuator, duty_trace((0, 0.1), (duty, 4.9), p_res=2.0e4))
    pressure, position, temperature = TABLE[duty]
    assert solution.p_act[-1] == pytest.approx(pressure, abs=10)  # Pa; settles within 10 after 5 s
    assert solution.x_d[-1] == pytest.approx(position, abs=1.5e-6)  # m; the table has three digits of a mm
    assert solution.T_act[-1] == pytest.approx(temperature, abs=0.1)


def test_gas_that_only_leaves_stays_on_its_adiabat(actuator):
    """Closed form `T = T_atm (p/p_atm)^((gamma-1)/gamma)`, as long as no air has come in."""
    solution = simulate(actuator, duty_trace((0, 0.05), (100, 1.0), p_res=2.0e4))
    evacuating = np.asarray(solution.m_dot_in) <= 0
    start = np.argmax(np.asarray(solution.p_act) < 9.0e4)
    assert evacuating[start:].all()
    expected = solution.T_act[start] * (solution.p_act / solution.p_act[start]) ** (0.396 / 1.396)
    np.testing.assert_allclose(solution.T_act[start:], expected[start:], rtol=2e-5)  # Heun at 0.5 ms


def test_step_response_times_of_the_independent_plant(actuator):
    """80 % from rest: pressure to 63 % in 195 ms and 95 % in 633 ms, position 284 and 688 ms."""
    solution = simulate(actuator, duty_trace((0, 0.1), (80, 4.9), p_res=2.0e4))

    def reach(signal, share):
        travelled = (signal - signal[0]) / (signal[-1] - signal[0])
        return float(solution.time[np.argmax(np.asarray(travelled) >= share)]) - 0.1

    times = [reach(signal, share) for signal in (solution.p_act, solution.x_d) for share in (0.63, 0.95)]
    np.testing.assert_allclose(times, [0.195, 0.633, 0.284, 0.688], atol=2e-3)  # the sampling and its rounding


def test_agrees_with_an_integrator_that_shares_no_code(actuator):
    """SciPy's LSODA on the same vector field, restarted at the duty step."""
    trace = duty_trace((70, 0.3), (20, 0.3), p_res=2.0e4)
    model = eqx.tree_at(lambda a: a.converter, actuator, vgtjax.Converter(opening_width=1e-5))
    drive = trace.drive()
    intervals = {i: jax.tree.map(lambda leaf, i=i: jnp.asarray(leaf[i]), drive) for i in (0, 300)}
    flat, restore = jax.flatten_util.ravel_pytree(model.start(trace.start(), intervals[0]))

    @jax.jit
    def field(y, inputs):
        return jax.flatten_util.ravel_pytree(model.vector_field(0.0, restore(y), inputs))[0]

    for (first, inputs), end in zip(intervals.items(), (0.3, 0.599), strict=True):
        solved = scipy.integrate.solve_ivp(
            lambda t, y, u: np.asarray(field(y, u)),
            (first * 1e-3, end),
            flat,
            "LSODA",
            args=(inputs,),
            rtol=1e-9,
            atol=1e-12,
        )
        flat = solved.y[:, -1]
    ours = simulate(model, trace, stepping=FixedStep(max_step=2e-5))
    assert ours.x_d[-1] == pytest.approx(float(restore(jnp.asarray(flat)).rod.body.position), abs=2e-8)
    assert ours.p_act[-1] == pytest.approx(float(restore(jnp.asarray(flat)).air_path.gas.pressure), abs=0.2)


def test_adaptive_steps_agree_with_fixed_ones(actuator):
    trace = duty_trace((0, 0.05), (75, 0.3), (30, 0.25), p_res=2.0e4)
    fixed = simulate(actuator, trace, stepping=FixedStep(max_step=2e-5))
    adaptive = simulate(actuator, trace, stepping=AdaptiveStep(rtol=1e-8, atol=1e-8))
    assert rms(adaptive.x_d - fixed.x_d) < 1e-8
    assert rms(adaptive.p_act - fixed.p_act) < 0.1


def test_adaptive_solver_that_gives_up_is_a_failure(actuator):
    trace = duty_trace((0, 0.05), (75, 0.3), p_res=2.0e4)
    solution = simulate(actuator, trace, stepping=AdaptiveStep(max_steps=20), throw=False)
    assert solution.result == vgtjax.RESULTS.max_steps_reached


def test_steps_that_do_not_keep_to_intervals_are_refused_where_these_are_needed():
    assert vgtjax.simulation.fixed(None) == FixedStep()
    with pytest.raises(vgtjax.InputError, match="need fixed steps, but stepping is AdaptiveStep; use FixedStep"):
        vgtjax.simulation.fixed(AdaptiveStep())


def test_any_diffrax_solver_can_take_the_steps(actuator):
    trace = duty_trace((0, 0.05), (75, 0.3), p_res=2.0e4)
    heun = simulate(actuator, trace, stepping=FixedStep(solver=diffrax.Heun()))
    ours = simulate(actuator, trace)
    # The printed plunger's h * rate is 1.1, below the limit of 1.5: nothing is stabilised.
    np.testing.assert_allclose(ours.x_d, heun.x_d, atol=1e-15)


def test_an_implicit_solver_that_finds_no_root_has_failed(actuator):
    hopeless = diffrax.ImplicitEuler(root_finder=diffrax.VeryChord(rtol=1e-14, atol=1e-14))
    trace = duty_trace((0, 0.05), (75, 0.3), p_res=2.0e4)
    solution = simulate(actuator, trace, stepping=FixedStep(max_step=5e-3, solver=hopeless), throw=False)
    assert solution.result == vgtjax.RESULTS.root_not_found


def test_slow_sampling_gives_the_same_trajectory(actuator):
    fast = duty_trace((0, 0.1), (75, 0.4), p_res=2.0e4)
    slow = duty_trace((0, 0.1), (75, 0.4), p_res=2.0e4, interval=1e-2)
    np.testing.assert_allclose(simulate(actuator, slow).x_d, simulate(actuator, fast).x_d[::10], atol=1e-12)


def test_uneven_sampling_is_fine(actuator):
    fast = duty_trace((75, 0.5), p_res=2.0e4)
    keep = np.sort(np.random.default_rng(0).choice(500, 350, replace=False))
    keep[0] = 0
    uneven = vgtjax.Trace(time=fast.time[keep], pwm=fast.pwm[keep], p_res=fast.p_res[keep])
    np.testing.assert_allclose(simulate(actuator, uneven).x_d, simulate(actuator, fast).x_d[keep], atol=3e-7)


def test_light_plunger_and_stiff_bristles_stay_stable(actuator):
    """Plain Heun diverges for a plunger below about 5 g."""
    wild = vgtjax.replace_parameters(
        actuator, {"converter.plunger_mass": 1e-3, "friction.bristle_stiffness": 1e6, "friction.bristle_damping": 4e3}
    )
    trace = duty_trace((0, 0.05), (75, 0.6), p_res=2.0e4)
    coarse, fine = simulate(wild, trace), simulate(wild, trace, stepping=FixedStep(max_step=1e-5))
    assert rms(coarse.x_d - fine.x_d) < 5e-6
    plain = simulate(wild, trace, stepping=FixedStep(solver=diffrax.Heun()), throw=False)
    assert plain.result == vgtjax.RESULTS.diverged


def stiffnesses(values):
    return jax.vmap(lambda k: eqx.tree_at(lambda a: a.diaphragm.stiffness, vgtjax.Actuator(), k))(jnp.asarray(values))


def test_a_batch_is_its_members(actuator):
    trace = duty_trace((0, 0.05), (75, 0.4), p_res=2.0e4)
    batch = jax.vmap(lambda a: simulate(a, trace).x_d)(stiffnesses([11000.0, 12000.0]))
    np.testing.assert_allclose(batch[1], simulate(actuator, trace).x_d, atol=1e-15)
    assert batch[0].max() > batch[1].max()


def test_one_bad_lane_leaves_the_others_alone(actuator):
    trace = duty_trace((0, 0.05), (75, 0.4), p_res=2.0e4)
    solution = jax.vmap(lambda a: simulate(a, trace, throw=False))(stiffnesses([12000.0, np.nan, 12000.0]))
    failed = np.asarray(solution.result != vgtjax.RESULTS.successful)
    assert failed.tolist() == [False, True, False]
    np.testing.assert_array_equal(solution.x_d[0], simulate(actuator, trace).x_d)


def test_a_failed_simulation_raises_its_advice(actuator):
    # The diaphragm swallows its chamber.
    bad, trace = vgtjax.replace_parameters(actuator, {"chamber.volume": 1e-6}), duty_trace((75, 0.3), p_res=2.0e4)
    advice = "The diaphragm swallows the chamber: enlarge chamber.volume"
    with pytest.raises(vgtjax.SimulationError, match=f"simulation of trace 'trace' failed: .*{advice}"):
        simulate(bad, trace)
    with pytest.raises(RuntimeError, match=advice):
        jax.jit(lambda model: simulate(model, trace).x_d)(bad).block_until_ready()


@pytest.mark.parametrize("stepping", [FixedStep(), AdaptiveStep(rtol=1e-3, atol=1e-3)], ids=["fixed", "adaptive"])
def test_the_number_of_duty_jumps_compiles_nothing_anew(actuator, stepping, monkeypatch):
    """What is not traced again has been compiled already."""
    traced, field = [], vgtjax.plants.AbstractPlant.vector_field

    def counting(self, time, state, drive):
        traced.append(time)
        return field(self, time, state, drive)

    monkeypatch.setattr(vgtjax.plants.AbstractPlant, "vector_field", counting)
    first, *others = [duty_trace(*[(20 + 10 * i, 0.042 / n) for i in range(n)], p_res=2.0e4) for n in (1, 2, 7)]
    simulate(actuator, first, stepping=stepping)
    count = len(traced)
    assert count > 0
    for trace in others:
        simulate(actuator, trace, stepping=stepping)
    assert len(traced) == count


def test_every_cause_of_failure_is_seen_in_a_batch(actuator):
    """Each lane has its own result; one that fails touches no other."""
    trace = duty_trace((0, 0.05), (75, 0.3), p_res=2.0e4)
    volumes, masses = jnp.asarray([60e-6, 1e-6, 60e-6]), jnp.asarray([0.63, 0.63, -0.63])

    @jax.jit
    @jax.vmap
    def run(volume, mass):
        model = vgtjax.replace_parameters(actuator, {"chamber.volume": volume, "diaphragm.mass": mass})
        return simulate(model, trace, throw=False)

    batch = run(volumes, masses)
    assert (batch.result == vgtjax.RESULTS.successful).tolist() == [True, False, False]
    assert (batch.result == vgtjax.RESULTS.unphysical).tolist() == [False, True, False]
    assert (batch.result == vgtjax.RESULTS.diverged).tolist() == [False, False, True]
    np.testing.assert_allclose(batch.x_d[0], simulate(actuator, trace).x_d, rtol=0, atol=1e-15)


def test_single_precision_is_good_enough_for_position(actuator):
    """Where memory or a GPU asks for it: position stays within 2 um, pressure within 25 Pa."""
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), actuator)
    solution = simulate(single, reference_trace("levels"))
    assert solution.x_d.dtype == jnp.float32
    states = reference("levels")
    assert rms(np.asarray(solution.x_d, float) - states["x_d"]) < 2e-6
    assert rms(np.asarray(solution.p_act, float) - states["p_act"]) < 25.0


def test_jit_compiles_once_for_many_parameters(actuator):
    trace = duty_trace((75, 0.2), p_res=2.0e4)
    traces = 0

    @jax.jit
    def final(stiffness):
        nonlocal traces
        traces += 1
        model = eqx.tree_at(lambda a: a.diaphragm.stiffness, actuator, stiffness)
        return simulate(model, trace, throw=False).x_d[-1]

    values = [float(final(k)) for k in (11000.0, 12000.0, 13000.0)]
    assert traces == 1
    assert values == sorted(values, reverse=True)


def test_missing_column_and_unknown_signal_are_named(actuator):
    with pytest.raises(vgtjax.InputError, match="needs the column pwm, which is missing"):
        simulate(actuator, vgtjax.Trace(time=np.arange(3.0)))
    solution = simulate(actuator, duty_trace((10, 0.05)))
    with pytest.raises(AttributeError, match=r"no signal 'x_q', only .*x_p"):
        _ = solution.x_q


def test_adjoints_that_make_no_sense_are_refused(actuator):
    with pytest.raises(vgtjax.InputError, match="adjoint must be ForwardMode"):
        simulate(actuator, duty_trace((10, 0.05)), adjoint=diffrax.BacksolveAdjoint())
    with pytest.raises(vgtjax.InputError, match="max_step must be a positive number"):
        FixedStep(max_step=0.0)
