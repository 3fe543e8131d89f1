"""Another actuator than the thesis's: that of the example, where the thesis only shows pictures of its own.

Its traces are simulated by an independent plant, with parameters that this package does not have and with noise.
"""

import functools
import pathlib

import numpy as np

import vgtjax
from vgtjax.estimation import plan_task, start_calibration

from ..study.read import EXAMPLE
from . import experiments

SETTLED = 0.5
"""s before the release in which a step is taken as settled."""
SMOOTHED = 9
"""Samples (ms) of the moving mean through which a noisy step is read."""
SCALE = {"pressure": ("p_act", 1 / experiments.MBAR), "position": ("x_d", 1e3)}
"""Column and scale to mbar and mm."""


@functools.cache
def trace(name: str) -> vgtjax.Trace:
    """A trace of the example, or of the same actuator beside this file: the ramp, at every second sample."""
    here = pathlib.Path(__file__).with_name(f"{name}.csv")
    return vgtjax.load_trace(here if here.exists() else EXAMPLE.parent / f"{name}.csv")


@functools.cache
def fitted_actuator() -> vgtjax.Actuator:
    """Our model, fitted to the staircase of duties alone, so that the steps stay unseen."""
    calibrator = start_calibration(plan_task(experiments.actuator(), [trace("levels_1")], []))
    while not calibrator.minimiser.progress.finished:
        calibrator.minimiser.step()
    model = calibrator.finish().model
    assert isinstance(model, vgtjax.Actuator)
    return model


def _step(duty: float) -> tuple[vgtjax.Trace, float, float]:
    """The step to a duty in percent, and when it begins and is released in s."""
    step = trace(f"step_{duty:g}")
    begin, release = step.time[step.jumps()]
    return step, float(begin), float(release)


def static_error(model: vgtjax.AbstractModel, duty: float, signal: str) -> float:
    """Trace less a model of ours once a step has settled in mbar or mm, counted from the rest before it."""
    step, begin, release = _step(duty)
    column, scale = SCALE[signal]
    error = getattr(step, column) - np.asarray(getattr(vgtjax.simulate(model, step), column))
    settled = (step.time > release - SETTLED) & (step.time < release)
    return scale * float(error[settled].mean() - error[step.time < begin].mean())


def response(duty: float, *, released: bool = False) -> experiments.Response:
    """What the traces show after the step to a duty in percent, or its release."""
    step, begin, release = _step(duty)
    window = np.full(SMOOTHED, 1 / SMOOTHED)
    pressure, position = (np.convolve(getattr(step, c), window, mode="valid") for c in ("p_act", "x_d"))
    time = step.time[SMOOTHED // 2 : -(SMOOTHED // 2)]
    part = time >= release if released else (time >= begin) & (time < release - SMOOTHED * 1e-3)
    return experiments.Response(time[part] - time[part][0], pressure[part], position[part])
