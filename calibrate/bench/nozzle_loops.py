"""Slow loops of an actuator whose vanes have another pivot and linkage, as a bench records them."""

import pathlib
from collections.abc import Sequence

import numpy as np

import vgtjax
from vgtjax.control import POSITION_NOISE
from vgtjax.traces import STANDARD_ATMOSPHERE

from ..output.files import columns_csv, write_text

TRUE = {
    "vane_force.nozzle.lead": 7.35e-3,
    "vane_force.linkage.ratio": 1.46,
    "diaphragm.stiffness": 12400.0,
    "diaphragm.preload": 51.0,
    "friction.static_force": 3.4,
    "friction.coulomb_force": 3.0,
}
"""Of the actuator whose loops are fitted; the search begins at the printed and assumed values."""
GAUGE = (1e5, 2e5, 3e5)
"""Turbine pressure of each loop in Pa."""
SECONDS, RATE = 10.0, 100.0
DEEPEST = 60e3
"""Pa below the atmosphere, in the chamber, where a loop turns."""
SEED = 16
UNITS = {"p_act": "Pa absolute", "p_trb": "Pa gauge", "x_d": "m"}
"""Of the columns that a loop is written with."""
STUDY = """name = "slow loops of a turbine"
data = "simulated by this package's own simulator, with noise on the position"
model = "mechanical"

[components]
vane_force = "turbine"

[[trace]]
file = "*.csv"

[fit]
free = [{free}]
"""


def record(values: dict[str, float], gauge: Sequence[float] = GAUGE, length: float = SECONDS) -> list[vgtjax.Trace]:
    """Slow loops of an actuator with such values, as a bench records them."""
    model = vgtjax.replace_parameters(vgtjax.MechanicalActuator(vane_force=vgtjax.Turbine()), values)
    rng, clock = np.random.default_rng(SEED), np.arange(0, length, 1 / RATE)
    pressure = STANDARD_ATMOSPHERE - DEEPEST * np.clip(1 - np.abs(2 * clock / length - 1), 0, 1)
    traces = []
    for each in gauge:
        inputs = {"p_act": pressure, "p_trb": np.full_like(clock, each)}
        true = vgtjax.simulate(model, vgtjax.Trace(clock, x_d=np.zeros_like(clock), **inputs)).x_d
        seen = np.asarray(true) + POSITION_NOISE * rng.normal(size=clock.size)
        traces.append(vgtjax.Trace(clock, x_d=seen, name=f"{each / 1e2:.0f} mbar", **inputs))
    return traces


def write_study(folder: pathlib.Path, traces: Sequence[vgtjax.Trace], free: Sequence[str]) -> pathlib.Path:
    """A study of loops with such entries free, and its traces beside it."""
    for trace in traces:
        signals = {f"{name} [{unit}]": np.asarray(trace.at(name)) for name, unit in UNITS.items()}
        write_text(folder / f"{trace.name}.csv", columns_csv({"time [s]": trace.time, **signals}))
    names = ", ".join(f'"{name}"' for name in free)
    write_text(folder / "study.toml", STUDY.format(free=names))
    return folder / "study.toml"
