"""Ten thousand actuators through a slow loop, beside numba on all cores."""

from collections.abc import Callable
from typing import Any

import numpy as np

import vgtjax
from vgtjax.experiments import SlowLoop
from vgtjax.population import Evaluator, Results, choose_factors

from .. import numba_plant
from ..table import Section, seconds, times
from ..timing import interleave

ROUNDS = 3
ACTUATORS = 10_000
LOOP = 10.0
"""s of the slow loop."""
SPREAD = 0.01
"""Relative standard deviation of everything that varies."""
VARIED = ("diaphragm.*", "friction.*", "chamber.*", "converter.*")


def measure() -> Section:
    """Times a population in both precisions and by numba, each a loop of 10 s for every actuator."""
    model, loop = vgtjax.Actuator(), SlowLoop((0.0,), LOOP)
    factors = choose_factors(model, VARIED, ["diaphragm.damping"])
    nominal = np.asarray(factors.pack(model))
    values = nominal * (1 + SPREAD * np.random.default_rng(0).standard_normal((ACTUATORS, len(nominal))))
    double, single = (Evaluator(model, factors, [loop], dtype=dtype) for dtype in (np.float64, np.float32))
    contestants: dict[str, Callable[[], Any]] = {
        "tolerance's lanes on all devices, float64": lambda: double(values),
        "tolerance's lanes on all devices, float32": lambda: single(values),
        "numba RK4 at 0.5 ms, prange, float64": lambda: _numba(model, factors, values, loop.traces[0]),
    }
    timings, results = interleave(contestants, ROUNDS)
    exact, rounded = list(results.values())[:2]
    about = (
        f"{ACTUATORS} actuators through a loop of {LOOP:g} s (20,000 steps each), read off as `tolerance` does; numba "
        f"only simulates; {SPREAD:.0%} of normal spread on {len(nominal)} quantities; {ROUNDS} rounds."
    )
    columns = ("contestant", "first call", "time", "actuators a second", "ratio")
    section = Section("Population", about, columns, notes=[_precision(exact, rounded)])
    reference = next(iter(timings.values()))
    for name, timing in timings.items():
        rate = f"{ACTUATORS / timing.median:.0f}"
        section.add(name, seconds(timing.first), seconds(timing.median), rate, times(timing.ratio(reference)))
    return section


def _numba(model: Any, factors: Any, values: np.ndarray, trace: vgtjax.Trace) -> tuple[np.ndarray, np.ndarray]:
    selection = vgtjax.Selection(numba_plant.ENTRIES)
    thetas = np.tile(selection.values(model), (len(values), 1))
    for column, name in enumerate(factors.entries):
        for place, entry in enumerate(numba_plant.ENTRIES):
            if entry == name:
                thetas[:, place] = values[:, column]
            elif entry.partition("[")[0] == name:
                thetas[:, place] *= values[:, column]
    whole = vgtjax.Trace(trace.time, pwm=trace.pwm, p_res=np.full_like(trace.time, 2.0e4))
    return numba_plant.simulate(thetas, whole, parallel=True)


def _precision(exact: Results, rounded: Results) -> str:
    """How far single precision is off, over the population."""
    gaps = [np.nanmax(np.abs(rounded[name] - exact[name])) for name in ("hysteresis_0mbar", "start_pressure_0mbar")]
    return (
        f"Single precision moves no actuator's mean loop width by more than {gaps[0]:.2g} Pa, nor the pressure "
        f"at which it begins to move by more than {gaps[1]:.2g} Pa."
    )
