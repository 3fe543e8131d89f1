"""Experiments on many actuators at once: values, exact derivatives, rows that fail, lanes and precision."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import scipy

import vgtjax
from vgtjax import Air, InputError, parameter, simulate
from vgtjax.experiments import SlowLoop, StepResponse
from vgtjax.population import Evaluator, Factors, SobolSample, choose_factors, run, spread_population

MODEL = vgtjax.Actuator(
    vane_force=vgtjax.HysteresisMap(
        closing=np.outer([1, 2], np.linspace(4, 2, 6)).ravel(), opening=np.outer([1, 2], np.linspace(-3, -1, 6)).ravel()
    )
)
FACTORS = choose_factors(
    MODEL,
    [
        "converter.plunger_mass",
        "converter.magnetic_force",
        "chamber.volume",
        "diaphragm.area",
        "diaphragm.preload",
        "diaphragm.stiffness",
        "friction.static_force",
        "friction.coulomb_force",
        "friction.viscous_damping",
        "vane_force.closing",
    ],
)
NOMINAL = np.asarray(FACTORS.pack(MODEL))
ROWS = NOMINAL * (1 + 0.05 * np.random.default_rng(1).normal(size=(6, len(NOMINAL))))
LOOP = SlowLoop((0.0, 1.5e5), seconds=4.0)


@pytest.fixture(scope="module")
def step():
    return StepResponse.around(MODEL, (60.0,), hold=0.6)


@pytest.fixture(scope="module")
def evaluator(step):
    return Evaluator(MODEL, FACTORS, [LOOP, step], lanes=4)


@pytest.fixture(scope="module")
def results(evaluator):
    return evaluator(ROWS)


def places(evaluator):
    """Every output with its columns."""
    ends = np.cumsum([output.size for output in evaluator.outputs])
    return [(output, slice(end - output.size, end)) for output, end in zip(evaluator.outputs, ends, strict=True)]


# Values.


def test_columns_are_outputs_and_points_of_curves(evaluator, step, results):
    names = [output.name for experiment in (LOOP, step) for output in experiment.outputs]
    assert [output.name for output in evaluator.outputs] == names
    assert tuple(results) == tuple(names)
    assert results.columns[:5] == (
        "hysteresis_0mbar",
        "start_pressure_0mbar",
        "end_pressure_0mbar",
        "loop_width_0mbar[0]",
        "loop_width_0mbar[1]",
    )
    assert len(set(results.columns)) == len(results.columns) == results.matrix.shape[1]
    for output, columns in places(evaluator):
        expected = results.matrix[:, columns] if output.axis else results.matrix[:, columns.start]
        np.testing.assert_array_equal(results[output.name], expected)
    width, curve = evaluator.outputs[0], evaluator.outputs[4]
    some = results.select([curve, width])
    assert list(some) == ["closing_pressure_0mbar", "hysteresis_0mbar"]
    np.testing.assert_array_equal(some["hysteresis_0mbar"], results["hysteresis_0mbar"])
    np.testing.assert_array_equal(some["closing_pressure_0mbar"], results["closing_pressure_0mbar"])
    assert some.causes == results.causes


def test_an_unknown_output_is_refused_with_the_nearest_one(results):
    assert "hysteresis_0mbar" in results
    assert "hysteresis" not in results
    with pytest.raises(InputError, match=r"output 'hysteresis_0' matches nothing; did you mean 'hysteresis_0mbar'\?"):
        results["hysteresis_0"]


def test_results_print_themselves_as_a_table(evaluator):
    failing = ROWS.copy()
    failing[2] *= np.nan
    found = evaluator(failing)
    first, header, *lines = repr(found).splitlines()
    assert first == "6 samples, 1 failed (1 diverged), 8 curves"
    assert header.split() == ["output", "unit", "mean", "deviation", "5%", "95%"]
    printed = {line.split()[0]: line.split()[1:] for line in lines}
    assert list(printed) == [output.name for output in found.outputs if not output.axis]
    width = np.delete(found["hysteresis_0mbar"], 2)
    figures = [width.mean(), width.std(ddof=1), *np.quantile(width, (0.05, 0.95))]
    assert printed["hysteresis_0mbar"][0] == "Pa"
    assert [float(cell) for cell in printed["hysteresis_0mbar"][1:]] == pytest.approx(figures, rel=5e-5)  # five digits
    table = found._repr_html_()
    assert f"<td>hysteresis_0mbar</td><td>Pa</td><td>{figures[0]:.5g}</td>" in table


def test_a_yield_counts_who_keeps_all_limits_with_the_interval_of_clopper_and_pearson(results):
    widths = np.sort(results["hysteresis_0mbar"])
    between = 0.5 * (widths[3] + widths[4])
    share, low, high = results.within({"hysteresis_0mbar": (None, between)})
    assert share == pytest.approx(4 / 6)
    # The ends are where four of six, or more, or fewer, have a probability of 2.5 %.
    assert scipy.stats.binom.sf(3, 6, low) == pytest.approx(0.025, rel=1e-6)
    assert scipy.stats.binom.cdf(4, 6, high) == pytest.approx(0.025, rel=1e-6)
    assert results.within({"hysteresis_0mbar": (None, between), "hysteresis_1500mbar": (1e9, None)}).share == 0.0
    assert results.within({}) == (1.0, pytest.approx(0.025 ** (1 / 6)), 1.0)
    with pytest.raises(InputError, match="output 'width' matches nothing"):
        results.within({"width": (0.0, 1.0)})
    with pytest.raises(InputError, match="a limit is one of a number, but 'closing_pressure_0mbar' is a curve"):
        results.within({"closing_pressure_0mbar": (0.0, 1.0)})


def test_a_row_is_what_simulating_and_reading_by_hand_gives(evaluator, results, step):
    row = 4
    model = FACTORS.unpack(MODEL, ROWS[row])
    by_hand = {}
    for experiment in (LOOP, step):
        runs = [simulate(model, trace) for trace in experiment.traces]
        x_d, p_act = jnp.stack([run.x_d for run in runs]), jnp.stack([run.p_act for run in runs])
        by_hand |= eqx.filter_jit(experiment.read)(x_d, p_act, model.air.pressure)
    for output, columns in places(evaluator):
        # The same steps, compiled another way: rounding grows over 8,000 of them.
        size = {"Pa": 1e5, "s": 1.0, "m": 1e-2}[output.unit]
        np.testing.assert_allclose(
            results.matrix[row, columns], np.ravel(by_hand[output.name]), atol=1e-9 * size, err_msg=output.name
        )
    assert not results.failed.any()
    assert np.all(np.isfinite(results.matrix))


def test_the_nominal_actuator_has_no_steady_error(evaluator):
    (found,) = evaluator(NOMINAL[None])["steady_error_60"]
    assert abs(found) < 1e-14  # m; the same steps, compiled another way


def test_a_row_that_fails_touches_no_other(evaluator, results):
    """In its place another actuator, or none at all: every other row is the same to the bit."""
    mixed = ROWS.copy()
    mixed[1, FACTORS.entries.index("converter.plunger_mass")] = 0.0
    mixed[2, FACTORS.entries.index("diaphragm.stiffness")] = np.nan
    mixed[4, FACTORS.entries.index("vane_force.closing")] = 1e300  # fails under gas only
    bad = np.array([False, True, True, False, True, False])
    found = evaluator(mixed)
    np.testing.assert_array_equal(found.failed, bad)
    np.testing.assert_array_equal(np.asarray(found.result == vgtjax.RESULTS.diverged), bad)
    with pytest.warns(DeprecationWarning, match="status of Results is called result"):
        assert found.status is found.result
    assert found.causes == tuple("diverged" if each else "successful" for each in bad)
    assert np.all(np.isnan(found.matrix[bad]))
    np.testing.assert_array_equal(found.matrix[~bad], results.matrix[~bad])
    np.testing.assert_array_equal(evaluator(ROWS[~bad]).matrix, results.matrix[~bad])


def test_an_actuator_that_cannot_exist_is_named_even_where_the_rod_stays_short():
    """A loop up to 10 % does not move the rod; a volume that is no number is left to the simulation."""
    swept = float(vgtjax.Actuator().diaphragm.displaced_volume(vgtjax.Actuator().diaphragm.travel))
    factors = choose_factors(vgtjax.Actuator(), ["chamber.volume"])
    values = np.array([6e-5, 1.001 * swept, 0.9 * swept, np.nan])[:, None]
    found = Evaluator(vgtjax.Actuator(), factors, [SlowLoop((0.0,), 2.0, 10.0)], lanes=4)(values)
    assert found.causes == ("successful", "successful", "unphysical", "diverged")
    assert np.all(np.isnan(found.matrix[2]))
    assert "2 failed (1 unphysical, 1 diverged)" in repr(found)


def test_lanes_and_their_padding_change_nothing(evaluator, results, step):
    alone = np.concatenate([evaluator(row[None]).matrix for row in ROWS])
    np.testing.assert_array_equal(alone, results.matrix)  # three of four lanes are padding
    other = Evaluator(MODEL, FACTORS, [step], lanes=5)
    assert other.lanes == 6  # a multiple of the tests' two devices
    # Other vector instructions may round otherwise; measured: they don't.
    np.testing.assert_allclose(other(ROWS).matrix, results.select(other.outputs).matrix, rtol=1e-9, atol=1e-15)


def test_single_precision_is_good_enough_for_populations(evaluator, results, step):
    single = Evaluator(MODEL, FACTORS, [LOOP, step], lanes=4, dtype=np.float32)(ROWS)
    assert not single.failed.any()
    assert single.matrix.dtype == np.float64
    # README promises 2 um and 25 Pa of signals. Measured here: 0.02 um, 0.1 Pa and 3 us at most; twenty times that is
    # allowed for other processors, but not nothing, or it would not be single precision.
    limit = {"Pa": 2.0, "s": 6e-5, "m": 4e-7}
    for output in evaluator.outputs:
        error = np.abs(single[output.name] - results[output.name]).max()
        assert 0 < error < limit[output.unit], output.name


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"experiments": []}, "needs an experiment and a lane, but there are 0 and 4; give both"),
        ({"lanes": 0}, "needs an experiment and a lane, but there are 1 and 0; give both"),
        ({"model": vgtjax.MechanicalActuator()}, "needs the column p_act or f_drive, which is missing"),
    ],
)
def test_an_evaluation_that_can_not_be_is_refused(arguments, sentence):
    given = {"model": MODEL, "experiments": [LOOP], "lanes": 4} | arguments
    with pytest.raises(InputError, match=sentence):
        Evaluator(given["model"], FACTORS, given["experiments"], lanes=given["lanes"])


# Exact derivatives of the actuator.

WEAK = {"converter.plunger_mass", "friction.static_force"}
"""What hardly moves a slow loop needs a larger step against rounding."""
STEPS = np.array([1e-5 if entry in WEAK else 1e-6 for entry in FACTORS.entries])
"""Relative steps of the differences. Larger ones pass kinks: where a reading's two samples change, its slope jumps."""
LIMIT = 1e-5
"""Of the norm. Measured: 2e-7 over all outputs of a unit, 2e-6 of any one above the rounding."""


@pytest.fixture(scope="module")
def derivatives(evaluator):
    """At the nominal actuator: exact and by central differences, both times the value, `(columns, factors)`."""
    size = NOMINAL * STEPS
    up, down = np.split(evaluator(np.concatenate([NOMINAL + np.diag(size), NOMINAL - np.diag(size)])).matrix, 2)
    return evaluator.gradient(NOMINAL[None]).matrix[0] * NOMINAL, ((up - down) / (2 * STEPS)[:, None]).T


@pytest.mark.parametrize("entry", FACTORS.entries)
def test_exact_derivatives_are_central_differences(entry, derivatives, evaluator):
    exact, difference = (each[:, FACTORS.entries.index(entry)] for each in derivatives)
    # Rounding of readings near 1e5 Pa, 1 s and 1e-2 m over the relative step of the differences.
    rounding = {"Pa": 1e-4, "s": 1e-8, "m": 1e-10}
    for output, columns in places(evaluator):
        off = np.linalg.norm(exact[columns] - difference[columns])
        assert off <= LIMIT * np.linalg.norm(difference[columns]) + rounding[output.unit], output.name
    for unit, least in rounding.items():
        of_unit = np.concatenate([np.arange(len(exact))[c] for output, c in places(evaluator) if output.unit == unit])
        norm = np.linalg.norm(difference[of_unit])
        if entry == "vane_force.closing" and unit in ("s", "m"):
            assert norm == 0.0  # steps are without gas
            assert not np.any(exact[of_unit])
            continue
        assert norm > 10 * least, "a dead factor"
        assert np.linalg.norm(exact[of_unit] - difference[of_unit]) < LIMIT * norm


def test_a_row_that_fails_has_no_derivatives_and_others_do(evaluator):
    bad = NOMINAL.copy()
    bad[0] = 0.0
    slopes = evaluator.gradient(np.stack([NOMINAL, bad, ROWS[0]]))
    found = slopes.matrix
    assert slopes.failed.tolist() == [False, True, False]
    assert slopes.failure == evaluator(bad[None]).failure
    assert np.all(np.isnan(found[1]))
    assert np.all(np.isfinite(found[[0, 2]]))
    np.testing.assert_array_equal(found[0], evaluator.gradient(NOMINAL[None]).matrix[0])


# Closed forms, on a model that has them.


class Lag(vgtjax.AbstractModel):
    """A rod that follows `gain_0 u + gain_1 u^2` of the duty `u` as a first-order lag, with 1 MPa/m of vacuum."""

    gain: jnp.ndarray = parameter((8e-5, 4e-7), symbol="c", unit=("m/%", "m/%^2"), source="toy")
    rate: jnp.ndarray = parameter(20.0, symbol="a", unit="1/s", source="toy")
    air: Air = eqx.field(default_factory=Air)

    needs = ("pwm",)
    longest_step = 1.0

    def start(self, start, drive):
        return jnp.zeros_like(self.rate)

    def vector_field(self, time, state, drive):
        return self.rate * (self.gain[0] * drive.pwm + self.gain[1] * drive.pwm**2 - state)

    def relaxation(self, time, state, drive):
        return None

    def observe(self, state, drive):
        return state, self.air.pressure - 1e6 * state

    def signals(self, state, drive):
        return {"x_d": state}

    def typical_state(self):
        return jnp.asarray(1e-2)


SMALL, LARGE = 1.0, 50.0
"""Duties in percent; at the small one the rod goes 0.08 mm, which is no way."""
LAGGING = StepResponse((SMALL, LARGE), hold=0.6, target=[0.0, 0.0])


def lag_evaluator(entries, lanes=6):
    return Evaluator(Lag(), Factors(entries), [LAGGING], lanes=lanes)


@pytest.fixture(scope="module")
def lag():
    """Level of the gain, and the rate."""
    return lag_evaluator(("gain", "rate"))


TIMES = [f"{name}_{LARGE:g}" for name in ("response_time_63", "response_time_95", "release_time")]


def test_a_lag_has_its_closed_form_outputs(lag):
    """`x = X (1 - e^(-a t))`, of which the rod goes all but e^-12 in the time that it has."""
    levels, rates = np.array([1.0, 1.2, 0.8]), np.array([20.0, 25.0, 30.0])
    found = lag(np.column_stack([levels, rates]))
    ends = levels * (8e-5 * LARGE + 4e-7 * LARGE**2) * -np.expm1(-rates * LAGGING.hold)
    # What Heun's steps are off by has decayed to nothing at the end.
    np.testing.assert_allclose(found[f"steady_error_{LARGE:g}"], ends, rtol=1e-6)
    whole = -np.expm1(-rates * LAGGING.hold)
    exact = np.stack([-np.log(1 - 0.63 * whole), -np.log(1 - 0.95 * whole), np.full(3, -np.log(0.37))]) / rates
    # A chord between samples 2 ms apart is off by a h^2 / 8, 15 us; Heun's steps of 0.5 ms add 2.
    np.testing.assert_allclose([found[name] for name in TIMES], exact, atol=2e-5)


def test_a_lag_has_its_closed_form_derivatives(lag):
    """Times go with `1 / a` and not with the gain; the end goes with the gain, and by `X t e^(-a t)` with the rate."""
    slopes = lag.gradient(np.array([[1.0, 20.0]]))
    end, decay = 8e-5 * LARGE + 4e-7 * LARGE**2, np.exp(-20.0 * LAGGING.hold)
    (error,) = slopes[f"steady_error_{LARGE:g}"]
    assert error[0] == pytest.approx(end * (1 - decay), rel=1e-6)  # as above
    # Heun's rate is off by (a h)^2 / 6, 2e-5, which the exponent makes twelve times as much.
    assert error[1] == pytest.approx(end * LAGGING.hold * decay, rel=5e-4)
    times = np.array([slopes[name][0] for name in TIMES])
    np.testing.assert_allclose(times[:, 0], 0.0, atol=1e-12)
    # Exact for the chord between two samples, whose slope is off by up to a h / 2 from that of the curve.
    exact = -np.log([1 / 0.37, 1 / 0.05, 1 / 0.37]) / 20.0**2
    np.testing.assert_allclose(times[:, 1], exact, rtol=20.0 * 2e-3 / 2)


def test_what_a_response_does_not_have_has_no_derivative(lag):
    point = np.array([[1.0, 20.0]])
    found = lag(point)
    missing = np.isnan(found.matrix[0])
    assert [name for name, gone in zip(found.columns, missing, strict=True) if gone] == [
        f"{name}_{SMALL:g}" for name in ("response_time_63", "response_time_95", "release_time")
    ]
    np.testing.assert_array_equal(np.isnan(lag.gradient(point).matrix[0]), np.stack([missing, missing], axis=1))


def test_the_derivative_by_a_curve_is_that_of_all_its_entries(lag):
    entries = lag_evaluator(("gain[0]", "gain[1]", "rate"))
    whole = lag.gradient(np.array([[1.0, 20.0]])).matrix[0]
    single = entries.gradient(np.array([[8e-5, 4e-7, 20.0]])).matrix[0]
    kept = ~np.isnan(whole[:, 0])
    summed = 8e-5 * single[:, 0] + 4e-7 * single[:, 1]
    # Rounding, in Pa at 1e4: the same arithmetic in another order.
    np.testing.assert_allclose(whole[kept, 0], summed[kept], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(whole[kept, 1], single[kept, 2], rtol=1e-9, atol=1e-9)
    assert np.abs(whole[kept, 0]).max() > 1e3


def test_a_population_runs_in_one_call():
    """Defaults: two percent on all that can vary, Sobol' points; the same rows as by hand."""
    varied = spread_population(Lag())
    assert varied.factors.entries == ("gain", "rate")
    found = run(varied, [LAGGING], samples=8)
    np.testing.assert_array_equal(varied.deviations, 0.02 * np.array([1.0, 20.0]))
    values = varied.values(SobolSample(2, 8, seed=0).points(0, 8))
    np.testing.assert_array_equal(found.matrix, lag_evaluator(varied.factors.entries, lanes=8)(values).matrix)
    other = run(varied, [LAGGING], samples=8, sampler="latin-hypercube", seed=3)
    assert not np.isin(other[f"steady_error_{LARGE:g}"], found[f"steady_error_{LARGE:g}"]).any()
