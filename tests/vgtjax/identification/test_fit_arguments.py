"""What `vgtjax.fit` asks of an estimation."""

import numpy as np
import pytest

import vgtjax
from vgtjax.estimation import Task, Unknown


class Begun(Exception):
    """A fit begins, of a task; nothing is fitted here."""

    def __init__(self, task: Task):
        self.task = task


@pytest.fixture
def asked(monkeypatch):
    """The task of a fit of a step, from its arguments."""

    def begin(task):
        raise Begun(task)

    monkeypatch.setattr("vgtjax.identification._fit.start_fit", begin)
    time = np.arange(0, 0.5, 1e-3)
    duty = np.where(time < 0.1, 0.0, 80.0)
    trace = vgtjax.Trace(time, pwm=duty, p_res=np.full_like(time, 2e4), x_d=0 * time, p_act=0 * time + 1e5)

    def task(**known) -> Task:
        with pytest.raises(Begun) as begun:
            vgtjax.fit(vgtjax.Actuator(), [trace], free=["diaphragm.stiffness"], **known)
        return begun.value.task

    return task


def test_what_is_known_of_sensors_reaches_the_task(asked):
    """As `[[report.sensor]]` of a study does: a fitted gain goes into errors, a freed one and an offset are priors."""
    freed = Unknown(gain=("p_act",), offset=("p_res",))
    task = asked(unknown=freed, gains={"x_d": 0.001, "p_act": 0.02}, offsets={"p_res": 150.0})
    assert task.gains == {"x_d": 0.001}
    assert set(task.deviations.values()) == {0.02, 150.0}
    assert asked().gains == {}
    assert not set(asked(unknown=freed).deviations.values()) & {0.02, 150.0}
