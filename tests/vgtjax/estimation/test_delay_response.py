"""Errors beside a late duty: longer where the sharp model answers a delay less than derivatives promise."""

import dataclasses

import numpy as np
import pytest
from support import duty_trace

import vgtjax
from vgtjax import FixedStep, SimulationError
from vgtjax.estimation import Progress, Unknown, _calibrator, plan_task, run_alone, start_calibration
from vgtjax.estimation._delay_response import LEAST, unanswered
from vgtjax.estimation._least_squares import estimate_uncertainty
from vgtjax.estimation._point import Point
from vgtjax.estimation._slopes import FARTHEST
from vgtjax.parts import with_sharp_seat

COLUMNS = np.random.default_rng(3).normal(size=(12, 3))
"""Of residuals by two values and a delay, all told to about a third; errors below are closed forms of it."""


class FreeTransform:
    positive = np.zeros(3, dtype=bool)

    def clip(self, coordinates):
        return coordinates


@dataclasses.dataclass(frozen=True)
class LinearCalibrator:
    """The end of a fit whose sharp model answers every move by `answer` of what its derivatives promise; simulations
    fail at delays above `fails_beyond`."""

    answer: float
    progress: Progress
    columns: np.ndarray = dataclasses.field(default_factory=lambda: COLUMNS)
    unknown: Unknown = dataclasses.field(default_factory=Unknown)
    fails_beyond: float = np.inf

    @property
    def task(self):
        return self

    @property
    def minimiser(self):
        return self

    @property
    def problem(self):
        return self

    transform = FreeTransform()
    count = len(COLUMNS)

    @property
    def point(self):
        return Point(self.answer * self.columns @ np.array(self.progress.coordinates), self.columns)

    def uncertainty(self):
        return estimate_uncertainty(np.ones(len(self.columns)), self.columns, len(self.columns))

    def corrected(self, progress):
        if progress.coordinates[-1] > self.fails_beyond:
            raise SimulationError("no simulation there")
        return dataclasses.replace(self, progress=progress)
        yield


END = Progress((0.0, 0.0, 0.0), late=True, corrections=3)


@pytest.mark.parametrize("scale", [1.0, 20.0], ids=["far", "near"])
@pytest.mark.parametrize("answer", [0.5, 0.8])
def test_errors_along_the_delay_are_longer_by_the_inverse_of_the_answer(answer, scale):
    """Also where a standard error is farther than a move may be."""
    calibrator = LinearCalibrator(answer, END, scale * COLUMNS)
    found = calibrator.uncertainty()
    assert (np.max(found.std_errors) > FARTHEST) == (scale == 1.0)
    lacking = run_alone(unanswered(calibrator))
    longer = found.covariance + np.outer(lacking, lacking)
    assert longer[-1, -1] == pytest.approx(found.covariance[-1, -1] / answer**2)
    # What goes with the delay is longer, what doesn't is not: (J^T dr/dx)^-1 J^T along one direction, in full.
    whole = np.linalg.inv(scale**2 * COLUMNS.T @ COLUMNS) * found.scale
    along = whole[-1] / np.sqrt(whole[-1, -1])
    np.testing.assert_allclose(longer, whole + np.outer(along, along) * (answer**-2 - 1), rtol=1e-6, atol=1e-12)


def test_one_simulation_beside_the_end_is_enough():
    lacking = run_alone(unanswered(LinearCalibrator(0.5, END, fails_beyond=0.0)))
    np.testing.assert_allclose(lacking, run_alone(unanswered(LinearCalibrator(0.5, END))), rtol=1e-9)


def test_an_answer_shortens_no_error_and_one_within_chatter_is_none():
    np.testing.assert_array_equal(run_alone(unanswered(LinearCalibrator(1.3, END))), np.zeros(3))
    lacking = [run_alone(unanswered(LinearCalibrator(answer, END)))[-1] for answer in (LEAST, 0.01, -1.0)]
    np.testing.assert_allclose(lacking, lacking[0], rtol=1e-6)
    assert lacking[0] > 0


@pytest.mark.parametrize(
    ("progress", "unknown"),
    [
        (dataclasses.replace(END, late=False), Unknown()),
        (dataclasses.replace(END, corrections=0), Unknown()),
        (dataclasses.replace(END, edges=((0.1,),)), Unknown()),
        (END, Unknown(numerics=False)),
    ],
    ids=["timely", "not corrected", "edges", "no numerical errors"],
)
def test_where_no_delay_is_free_or_nothing_is_corrected_nothing_is_asked(progress, unknown):
    calibrator = LinearCalibrator(0.5, progress, unknown=unknown, fails_beyond=-np.inf)
    np.testing.assert_array_equal(run_alone(unanswered(calibrator)), np.zeros(3))


FREE = ["diaphragm.stiffness", "diaphragm.preload", "chamber.volume"]


@pytest.fixture(scope="module")
def ended():
    """A fit at its end, of a duty that was 4 ms late for a plant without a smooth seat."""
    trace = duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4)
    applied = trace.replace(pwm=np.concatenate([np.zeros(4), trace.pwm[:-4]]))
    run = vgtjax.simulate(with_sharp_seat(vgtjax.Actuator()), applied, stepping=FixedStep(max_step=1e-4))
    rng, count = np.random.default_rng(5), len(trace.time)
    seen = trace.replace(x_d=run.x_d + rng.normal(0, 8e-6, count), p_act=run.p_act + rng.normal(0, 60.0, count))
    return run_alone(start_calibration(plan_task(vgtjax.Actuator(), [seen], free=FREE, unknown=Unknown())).ending())


def test_a_calibration_has_it_in_its_errors_and_their_budget(ended, monkeypatch):
    bare = ended.uncertainty().std_errors
    lacking = bare * [0.5, -2.0, 1.0, 3.0]

    def known(calibrator):
        assert calibrator is ended
        return lacking
        yield

    before = ended.finish()
    monkeypatch.setattr(_calibrator, "unanswered", known)
    found = ended.finish()
    more = found.uncertainty.covariance - before.uncertainty.covariance
    np.testing.assert_allclose(more, np.outer(lacking[:-1], lacking[:-1]), rtol=1e-6)
    assert found.duty_delay_error == pytest.approx(found.transform.scale[-1] * np.sqrt(10) * bare[-1])
    np.testing.assert_allclose(found.budget.combined, found.std_errors, rtol=1e-6)
