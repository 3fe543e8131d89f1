"""Traces that the benchmarks run on: the example that ships, and noise-free reference states."""

import dataclasses
import pathlib

import numpy as np

import vgtjax
from vgtjax import InputError

EXAMPLE = pathlib.Path(__file__).parents[1] / "example"
_REFERENCE = pathlib.Path(__file__).parents[2] / "tests" / "data"
FIT_TRACES = ("step_50", "step_80", "step_100", "levels_1", "pyramid")


@dataclasses.dataclass(frozen=True, eq=False)
class Reference:
    """States by an independent plant at 10 us steps for the printed parameters: position in m, pressure in Pa."""

    trace: vgtjax.Trace
    x_d: np.ndarray
    p_act: np.ndarray

    def errors(self, x_d: np.ndarray, p_act: np.ndarray) -> tuple[float, float]:
        """RMS differences in um and Pa over the samples of the reference, of which more may be given."""
        count = len(self.x_d)
        return rms(np.asarray(x_d)[:count] - self.x_d) * 1e6, rms(np.asarray(p_act)[:count] - self.p_act)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def reference(name: str) -> Reference:
    """The reference called `levels` or `step_80`.

    **Raises:** `InputError` outside of a source checkout, where the file is missing.
    """
    path = _REFERENCE / f"reference_{name}.npz"
    try:
        stored = np.load(path)
    except FileNotFoundError as error:
        raise InputError(
            f"this benchmark needs a source checkout, but {path} is missing; run it inside the repository"
        ) from error
    trace = vgtjax.Trace(stored["time"], pwm=stored["pwm"], p_res=stored["p_res"], name=name)
    return Reference(trace, stored["x_d"], stored["p_act"])


def inputs(trace: vgtjax.Trace) -> tuple[np.ndarray, np.ndarray]:
    """Duty and reservoir pressure of a trace that begins at rest.

    **Raises:** `InputError` for any other, which the plants beside this package can't start.
    """
    if trace.pwm is None or trace.p_res is None or not trace.start().at_rest:
        raise InputError(f"{trace.name}: a benchmark's trace must begin at rest and hold pwm and p_res; choose another")
    return trace.pwm, trace.p_res


def lengthened(trace: vgtjax.Trace, seconds: float) -> vgtjax.Trace:
    """The trace's inputs repeated or cut to a length, at its sampling rate."""
    pwm, p_res = inputs(trace)
    interval = trace.longest_interval
    count = round(seconds / interval) + 1
    return vgtjax.Trace(
        np.arange(count) * interval,
        pwm=np.resize(pwm, count),
        p_res=np.resize(p_res, count),
        name=f"{trace.name}, {seconds:g} s",
    )


def example_traces() -> list[vgtjax.Trace]:
    """The traces that the example fits."""
    return [vgtjax.load_trace(EXAMPLE / f"{name}.csv") for name in FIT_TRACES]


def seconds_of(traces: list[vgtjax.Trace]) -> float:
    """Time that the traces last together in s."""
    return sum(float(trace.time[-1] - trace.time[0]) for trace in traces)
