"""Recovery of a known truth: statistics in closed form, and campaigns whose noise is that of the traces."""

import dataclasses

import numpy as np
import pytest
from known_truth import FREE, NOISE, TRUTH, bench

import vgtjax
from vgtjax.assurance import Recovery, Refit, Truth, refitting
from vgtjax.estimation import plan_task, run_alone, run_together

RNG = np.random.default_rng(8)
FILTERED = np.array([0.8])
"""Memory of a noise behind 36 Hz at 1 kHz; its neighbours differ by a third of what white noise would."""


@pytest.fixture(scope="module")
def task():
    return plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, values=TRUTH)


@pytest.fixture(scope="module")
def truth(task):
    return run_alone(Truth.of(task, task.fit))


def refits(recovery, estimates, claimed):
    return [
        Refit(number, True, "", tuple((recovery.truth + each).tolist()), (claimed,) * len(recovery.truth))
        for number, each in enumerate(estimates)
    ]


def test_honest_claims_are_called_honest(task):
    nothing = Recovery.of(task, [])
    missed = RNG.normal(0, 0.01, (400, 3))
    found = Recovery.of(task, refits(nothing, missed, 0.01))
    assert found.total == pytest.approx(0.95, abs=0.02)
    np.testing.assert_allclose(found.spread, nothing.scale * missed.std(axis=0, ddof=1), rtol=1e-9)
    np.testing.assert_allclose(found.bias, nothing.scale * missed.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(found.claimed, 0.01 * nothing.scale)
    assert len(found.sentences) == 2
    assert found.sentences[-1].startswith("this cannot show a wrong structure")


def test_errors_that_are_too_small_and_biases_are_named(task):
    nothing = Recovery.of(task, [])
    missed = RNG.normal(0, 0.01, (64, 3)) * [1.0, 3.0, 1.0] + [0.0, 0.0, 0.008]
    found = Recovery.of(task, refits(nothing, missed, 0.01))
    said = " ".join(found.sentences[1:])
    entries = task.selection.entries
    assert f"{entries[1]}: only" in said
    assert f"{entries[2]}: estimates are off by +0." in said
    assert entries[0] not in said


def test_one_campaign_alone_has_no_spread(task):
    nothing = Recovery.of(task, [])
    blind = Refit(1, True, "", tuple(nothing.truth.tolist()), (None, 0.01, 0.01))
    found = Recovery.of(task, [*refits(nothing, [np.zeros(3)], 0.01), blind])
    assert np.isnan(found.spread).tolist() == [True, False, False]


def test_what_was_not_determined_or_failed_does_not_count(task):
    nothing = Recovery.of(task, [])
    good = refits(nothing, RNG.normal(0, 0.01, (6, 3)), 0.01)
    blind = Refit(6, True, "", tuple(nothing.truth.tolist()), (None, 0.01, 0.01))
    found = Recovery.of(task, [*good, blind, Refit(7, False, "it ran away")])
    assert found.known.tolist() == [6, 7, 7]
    assert found.failed == ["campaign 7: it ran away"]
    assert np.all(np.isfinite(found.spread))
    assert f"{task.selection.entries[0]}: determined in 6 of 7 campaigns" in found.sentences
    title, _, row, *_ = repr(found).splitlines()
    assert title == "Recovery: 7 campaigns of a known truth, 1 more did not converge"
    shown = [task.selection.entries[0], *(f"{each[0]:.3g}" for each in (found.bias, found.spread, found.claimed))]
    assert row.split() == [*shown, f"{100 * found.coverage[0]:.0f}", "%", "6"]


def test_a_campaign_has_the_noise_of_the_traces(task, truth):
    (trace,) = truth.campaign(0, seed=1).fit
    (other,) = truth.campaign(1, seed=1).fit
    (same,) = truth.campaign(0, seed=1).fit
    for channel, (name, noise) in enumerate(NOISE.items()):
        new = getattr(trace, name) - truth.clean[0][:, channel]
        assert np.std(new) == pytest.approx(noise, rel=0.1)
        # The offset of the sensor that the trace was recorded with.
        assert np.mean(new) == pytest.approx({"x_d": 2e-5, "p_act": -150.0}[name], abs=0.2 * noise)
        assert np.any(getattr(other, name) != getattr(trace, name))
        np.testing.assert_array_equal(getattr(same, name), getattr(trace, name))
    np.testing.assert_array_equal(trace.pwm, task.fit[0].pwm)


def test_a_fit_of_ones_own_campaigns_is_as_good_as_it_claims(task, truth):
    found = {}
    run_together({number: refitting(truth, number, 5) for number in range(12)}, found.__setitem__)
    recovery = Recovery.of(task, [found[number] for number in range(12)])
    assert recovery.failed == []
    # 36 intervals of 95 %: fewer than 30 hold the truth once in two thousand.
    assert recovery.total * recovery.known.sum() >= 30
    np.testing.assert_allclose(recovery.spread / recovery.claimed, 1.0, atol=0.7)  # of a dozen: 0.2 is one deviation


def counting(computation, slopes):
    """A computation that adds to `slopes` whenever it asks for derivatives."""
    answer = None
    while True:
        try:
            question = computation.send(answer)
        except StopIteration as end:
            return end.value
        slopes.extend(each for each in question if each.selection is not None)
        answer = yield question


def test_noise_behind_a_filter_is_no_reason_to_search(truth):
    """White noise of what neighbours show would leave nine times as much, and a fit look for a late duty."""
    filtered = [
        {name: dataclasses.replace(sensor, memory=FILTERED, deviation=0.6 * sensor.deviation) for name, sensor in each}
        for each in ([*sensors.items()] for sensors in truth.sensors)
    ]
    slopes = []
    refit = run_alone(counting(refitting(dataclasses.replace(truth, sensors=filtered), 0, 5), slopes))
    assert refit.converged
    assert len(slopes) <= 1  # around its end, where that is more than three standard errors from the truth


def test_what_is_known_beforehand_is_told_anew_in_every_campaign(task, truth):
    """Around the truth, whatever the study's value is that its own prior is about."""
    known = {"chamber.volume": 1e-6, "diaphragm.preload": 2.0}
    stated = dataclasses.replace(task, deviations=known, centers={"chamber.volume": 7e-5})
    again = dataclasses.replace(truth, task=stated)
    drawn = [again.campaign(number, 0) for number in range(200)]
    for entry, deviation in known.items():
        found = np.array([each.centers[entry] for each in drawn])
        # The deviation is that of the logarithm, about the stated value, where the volume is another.
        expected = deviation * TRUTH[entry] / stated.centers.get(entry, TRUTH[entry])
        assert found.mean() == pytest.approx(TRUTH[entry], abs=4 * expected / np.sqrt(200))
        assert found.std() == pytest.approx(expected, rel=0.2)  # four standard errors of 200 draws
    # A refit believes a prior as wide as it was drawn, also where the logarithm is of another value.
    width = 1e-6 / 7e-5
    for each in drawn[:5]:
        assert each.prior.precision[task.selection.entries.index("chamber.volume")] == pytest.approx(1 / width)
    # Noise of the traces is as it was without.
    np.testing.assert_array_equal(drawn[3].fit[0].x_d, truth.campaign(3, 0).fit[0].x_d)
