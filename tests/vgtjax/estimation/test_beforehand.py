"""What is known of values beforehand: priors of free ones, tolerances of held ones."""

import jax
import numpy as np
import pytest
from known_truth import FREE, TRUTH, bench

import vgtjax
from vgtjax.estimation import Unknown, calibrate, plan_task, start_calibration


def fit(free, values=None, **deviations):
    named = {name.replace("__", "."): each for name, each in deviations.items()}
    return calibrate(plan_task(vgtjax.Actuator(), [bench(0)], free=free, values=values, deviations=named))


@pytest.fixture(scope="module")
def plain():
    return fit(FREE)


def test_a_prior_adds_its_information():
    """Of one parameter: the inverse variances add, and the value is the mean weighed by them."""
    others = {name: value for name, value in TRUTH.items() if name != "diaphragm.stiffness"}
    alone = fit(["diaphragm.stiffness"], others)
    size = alone["diaphragm.stiffness"].std_error
    start = alone["diaphragm.stiffness"].value + 4 * size
    both = fit(["diaphragm.stiffness"], {**others, "diaphragm.stiffness": start}, diaphragm__stiffness=2 * size)
    expected = (alone["diaphragm.stiffness"].value + 0.25 * start) / 1.25
    # Each fit ends within a tenth of a standard error of its minimum.
    assert both["diaphragm.stiffness"].value == pytest.approx(expected, abs=0.15 * size)
    # Errors are scaled by what remains, to a percent or two the same in both.
    assert both["diaphragm.stiffness"].std_error == pytest.approx(size / np.sqrt(1.25), rel=0.03)


def test_a_prior_is_of_what_moves():
    """Of the logarithm, or of the value itself; one deviation from the start is the same in both."""
    entry, deviation = "chamber.volume", 2e-5
    start = float(vgtjax.Actuator().chamber.volume)
    half = {"log": np.log(2) * start, "linear": 0.5 * start}
    for scale, distance in half.items():
        task = plan_task(
            vgtjax.Actuator(), [bench(0)], free=[entry], deviations={entry: deviation}, scales={entry: scale}
        )
        coordinates = np.asarray(task.transform().to_coordinates(np.array([0.5 * start])))
        assert float(task.prior.residuals(coordinates)[0]) == pytest.approx(-distance / deviation, rel=1e-12)


def test_a_fit_ends_the_same_however_its_values_move(plain):
    linear = calibrate(plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, scales={"diaphragm.*": "linear"}))
    assert not linear.transform.positive[linear.task.selection.entries.index("diaphragm.stiffness")]
    # Each fit ends within a tenth of a standard error of its minimum, and errors are those of the same derivatives.
    assert np.max(np.abs(linear.values - plain.values) / plain.std_errors) < 0.2
    np.testing.assert_allclose(linear.std_errors, plain.std_errors, rtol=0.05)


def test_another_scale_is_refused():
    with pytest.raises(vgtjax.InputError, match="must be one of log, linear, but it is 'cubic'; choose one"):
        plan_task(vgtjax.Actuator(), [bench(0)], scales={"diaphragm.mass": "cubic"})


def test_a_tight_prior_holds_and_a_wide_one_says_nothing(plain):
    tight = fit(FREE, {"chamber.volume": 5.7e-5}, chamber__volume=1e-12)
    assert tight["chamber.volume"].value == pytest.approx(5.7e-5, rel=1e-6)
    wide = fit(FREE, chamber__volume=1.0)
    np.testing.assert_allclose(wide.values, plain.values, rtol=1e-6)
    np.testing.assert_allclose(wide.std_errors, plain.std_errors, rtol=1e-6)


def test_what_only_a_prior_tells_is_known_as_well_as_that_says():
    """Whatever the traces leave: of a stiffness that is held a tenth too large, and of a rod that stays short of its
    end stop, whose travel no sample feels."""
    values = {"diaphragm.stiffness": 1.1 * TRUTH["diaphragm.stiffness"]}
    free = ["chamber.volume", "diaphragm.travel"]
    wrong = fit(free, values, diaphragm__travel=2e-4)
    assert wrong.uncertainty.scale > 50
    assert wrong["diaphragm.travel"].std_error == pytest.approx(2e-4, rel=1e-9)
    assert wrong.determined.all()
    place = wrong.task.selection.entries.index("diaphragm.travel")
    assert wrong.budget.windowed[place] == pytest.approx(2e-4, rel=1e-6)


def test_a_prior_may_be_about_another_value_than_the_start():
    """Then a fit ends the same wherever it starts."""
    about = {"centers": {"chamber.volume": 6.0e-5}, "deviations": {"chamber.volume": 1e-9}}
    ends = [
        calibrate(plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, values={"chamber.volume": start}, **about))
        for start in (5.0e-5, 6.0e-5)
    ]
    # Each fit ends within a tenth of a standard error of its minimum.
    assert np.max(np.abs(ends[0].values - ends[1].values) / ends[1].std_errors) < 0.2
    assert ends[0]["chamber.volume"].value == pytest.approx(6.0e-5, rel=0.01)


def test_a_prior_about_what_can_not_be_is_refused():
    """Of what is free: a tolerance of what is held may be about zero."""
    bad = {"chamber.volume": (-1.0, "a positive"), "diaphragm.preload": (np.nan, "a finite")}
    for name, (value, kind) in bad.items():
        with pytest.raises(vgtjax.InputError, match=rf"what a prior of {name} is about must be {kind} number"):
            plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, centers={name: value})
    known = {"deviations": {"diaphragm.damping": 2.0}, "centers": {"diaphragm.damping": 0.0}}
    assert plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, **known).centers == {}


def test_the_tolerance_of_what_is_held_goes_into_every_error(plain):
    """Each variance grows by the square of what the value moves by when the held one is off by its tolerance."""
    area = float(vgtjax.Actuator().diaphragm.area)
    moved = fit(FREE, {"diaphragm.area": 1.002 * area})
    tolerant = fit(FREE, diaphragm__area=0.002 * area)
    np.testing.assert_allclose(tolerant.values, plain.values, rtol=1e-9)
    grown = np.sqrt(plain.std_errors**2 + (moved.values - plain.values) ** 2)
    # First order, and each fit ends within a tenth of a standard error of its minimum.
    np.testing.assert_allclose(tolerant.std_errors, grown, rtol=0.1)
    assert np.any(tolerant.std_errors > 3 * plain.std_errors)


def test_residuals_carry_the_prior():
    """So that any optimiser minimises the same."""
    task = plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, deviations={"chamber.volume": 1e-6})
    minimiser = start_calibration(task).minimiser
    here = np.array(minimiser.progress.coordinates) + 0.1
    residuals = minimiser.problem.residuals(jax.numpy.asarray(here))
    assert len(residuals) == len(minimiser.point.residuals)
    assert float(np.sum(np.square(residuals[-3:]))) > 0


def test_the_fit_of_the_library_knows_it_too(plain):
    """`vgtjax.fit` takes what the study of the command `fit` says."""
    tight = {"chamber.volume": 1e-12}
    values = {"chamber.volume": 5.7e-5}
    parameters_only = Unknown(duty_delay=False, duty_hold=False, noise="white", loss="gaussian", numerics=False)
    found = vgtjax.fit(
        vgtjax.Actuator(), [bench(0)], free=FREE, values=values, unknown=parameters_only, deviations=tight
    )
    assert found["chamber.volume"].value == pytest.approx(5.7e-5, rel=1e-6)
    assert found.progress.corrections == 0
    assert found.task.deviations == tight


def test_a_deviation_that_is_not_positive_is_refused():
    with pytest.raises(vgtjax.InputError, match=r"the deviation of chamber.volume must be a positive number"):
        fit(FREE, chamber__volume=0.0)
