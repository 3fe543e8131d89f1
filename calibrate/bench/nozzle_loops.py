"""Slow loops of an actuator whose vanes have another pivot and linkage, as a bench records them."""

from collections.abc import Sequence

import numpy as np

import vgtjax

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
NOISE = 8e-6
"""m of the position's sensor."""
SEED = 16


def record(values: dict[str, float], gauge: Sequence[float] = GAUGE, length: float = SECONDS) -> list[vgtjax.Trace]:
    """Slow loops of an actuator with such values, as a bench records them."""
    model = vgtjax.replace_parameters(vgtjax.MechanicalActuator(vane_force=vgtjax.Turbine()), values)
    rng, clock = np.random.default_rng(SEED), np.arange(0, length, 1 / RATE)
    pressure = 101013.0 - DEEPEST * np.clip(1 - np.abs(2 * clock / length - 1), 0, 1)
    traces = []
    for each in gauge:
        inputs = {"p_act": pressure, "p_trb": np.full_like(clock, each)}
        true = vgtjax.simulate(model, vgtjax.Trace(clock, x_d=np.zeros_like(clock), **inputs)).x_d
        seen = np.asarray(true) + NOISE * rng.normal(size=clock.size)
        traces.append(vgtjax.Trace(clock, x_d=seen, name=f"{each / 1e2:.0f} mbar", **inputs))
    return traces
