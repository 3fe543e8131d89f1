"""Bench campaigns of actuators with known parameters, by the plant of the benchmarks: no simulator of ours, nothing
smoothed, steps of 10 us. For measuring how honest the intervals of a fit are."""

import dataclasses
import pathlib
from typing import Any

import numpy as np
import scipy.signal
from jaxtyping import Float

import vgtjax
from vgtjax.control import POSITION_NOISE, PRESSURE_NOISE
from vgtjax.experiments import StandardRun
from vgtjax.parts import OPERATING_POINTS

from . import numba_plant, structured_plant
from .structured_plant import Gas, Hold, Structure

Run = tuple[str, Float[np.ndarray, " time"], float, float]
"""Name, duty in % at every sample, turbine pressure in Pa gauge, and s between samples."""

SPREAD = {
    "converter.membrane_stiffness": 0.08,
    "converter.return_spring_stiffness": 0.08,
    "converter.plunger_damping": 0.10,
    "converter.reservoir_orifice_slope": 0.08,
    "converter.reservoir_orifice_saturation": 0.04,
    "converter.atmosphere_orifice[0]": 0.10,
    "converter.atmosphere_orifice[1]": 0.10,
    "converter.atmosphere_orifice[2]": 0.10,
    "chamber.volume": 0.05,
    "diaphragm.mass": 0.06,
    "diaphragm.preload": 0.06,
    "diaphragm.stiffness": 0.05,
    "diaphragm.travel": 0.01,
    "friction.static_force": 0.12,
    "friction.coulomb_force": 0.12,
    "friction.bristle_stiffness": 0.15,
    "friction.bristle_damping": 0.15,
    "friction.viscous_damping": 0.12,
    "friction.stribeck_velocity": 0.20,
}
"""Of the logarithm of what differs from unit to unit; uniform over 1.7 of it on either side."""
NOISE = {"x_d": POSITION_NOISE, "p_act": PRESSURE_NOISE}
"""m and Pa."""
RATE = 1e-3
"""s between samples."""
LOOP_RATE, LIVELY_RATE = 1e-2, 2e-3
"""s between samples of an end-of-line bench, of its slow loops and of its random levels."""
STEP = 1e-5
"""s."""
GAS_SPREAD = 0.12
"""Of the logarithm of the vane force's two sides from unit to unit; normal."""
SIDES = {"side_speed": (1e-4, 1e-3), "reversal_distance": (3e-5, 1.2e-4)}
"""m/s and m, between which the vane force's change of sides is drawn, evenly in the logarithm."""


@dataclasses.dataclass(frozen=True)
class Fault:
    """What is wrong with a campaign.

    `delay` in s of the duty beside its record, the share of the position's samples that are `outliers` by thirty
    deviations, the `low_pass` in Hz behind which the noise of the position is (not the signal), and the record keeps
    `every` so many samples.
    """

    name: str
    delay: float = 0.0
    outliers: float = 0.0
    low_pass: float | None = None
    every: int = 1


FAULTS = (
    Fault("nothing"),
    Fault("duty 4 ms late", delay=0.004),
    Fault("0.3 % outliers of 30 deviations", outliers=0.003),
    Fault("noise of the position behind 40 Hz", low_pass=40.0),
    Fault("recorded at 500 Hz, edges at any millisecond", every=2),
    Fault("recorded at 500 Hz, duty 3 ms late", delay=0.003, every=2),
)


@dataclasses.dataclass(frozen=True)
class Fleet:
    """What a bench records of every unit: a slow loop, and a lively run as well if it is `lively`; or slow loops at
    several turbine `pressures` in Pa gauge, with a duty that is held or linear between samples."""

    name: str
    lively: bool
    pressures: tuple[float, ...] = ()
    duty_hold: Hold = "zero-order"


FLEETS = (
    Fleet("a slow loop", False),
    Fleet("a slow loop and a lively run", True),
    Fleet("three slow loops with exhaust gas, duty held", False, OPERATING_POINTS),
    Fleet("three slow loops with exhaust gas, duty linear", False, OPERATING_POINTS, "linear"),
)


def draw_unit(rng: np.random.Generator) -> vgtjax.Actuator:
    """An actuator of the series: its friction is passive, and its magnetic force differs in scale and bend."""
    nominal = vgtjax.Actuator()
    selection = vgtjax.Selection(tuple(SPREAD))
    factors = np.exp(np.array(list(SPREAD.values())) * rng.uniform(-1.7, 1.7, len(SPREAD)))
    values = dict(zip(SPREAD, selection.values(nominal) * factors, strict=True))
    stiction, sliding = "friction.static_force", "friction.coulomb_force"
    values[stiction] = max(values[stiction], 1.05 * values[sliding])
    least = values["friction.bristle_damping"] * (values[stiction] / values[sliding] - 1)
    values["friction.viscous_damping"] = max(values["friction.viscous_damping"], 1.05 * least)
    unit = selection.unpack(nominal, np.array(list(values.values())))
    scale, bend = 1 + 0.04 * rng.uniform(-1, 1), 1 + 0.03 * rng.uniform(-1, 1)
    pull = np.asarray(vgtjax.get_parameter(nominal, "converter.magnetic_force")) * scale * bend ** np.arange(5)
    return vgtjax.replace_parameters(unit, {"converter.magnetic_force": pull})


def record(unit: vgtjax.Actuator, rng: np.random.Generator, fault: Fault) -> list[vgtjax.Trace]:
    """Two steps, random levels and a staircase, 31 s at 1 kHz, with noisy sensors off by constants."""
    return [_record(unit, name, duty, rng, fault) for name, duty in _duties(rng)]


def record_fleet(unit: vgtjax.Actuator, rng: np.random.Generator, fleet: Fleet) -> list[vgtjax.Trace]:
    """A slow loop at 100 Hz and, for a lively fleet, random levels at 500 Hz, whose duty changes with the samples; or
    slow loops with exhaust gas."""
    if fleet.pressures:
        structure, gas = Structure(fleet.duty_hold, vane_force="speed-map"), draw_gas(rng)
        return [_record_gas(unit, structure, gas, run, rng) for run in _loops(fleet.pressures)]
    traces = [_record(unit, "loop", _slow_loop(), rng, FAULTS[0], LOOP_RATE)]
    if fleet.lively:
        traces.append(_record(unit, "lively", _lively_levels(rng), rng, FAULTS[0], LIVELY_RATE))
    return traces


def record_end_of_line(unit: vgtjax.Actuator, rng: np.random.Generator) -> list[vgtjax.Trace]:
    """Three slow loops at 100 Hz and random levels at 500 Hz."""
    more = [record_fleet(unit, rng, FLEETS[0])[0] for _ in range(2)]
    first, lively = record_fleet(unit, rng, FLEETS[1])
    loops = [loop.replace(name=f"loop_{number}") for number, loop in enumerate((first, *more), 1)]
    return [*loops, lively]


def draw_gas(rng: np.random.Generator) -> Gas:
    """The force of the exhaust gas on the vanes of a unit."""
    closing, opening = np.exp(GAS_SPREAD * rng.standard_normal(2))
    sides = {name: float(np.exp(rng.uniform(*np.log(bounds)))) for name, bounds in SIDES.items()}
    return Gas(Gas.closing * closing, Gas.opening * opening, **sides)


def record_structure(
    unit: vgtjax.Actuator,
    structure: Structure,
    pressures: tuple[float, ...],
    every: int,
    rng: np.random.Generator,
) -> list[vgtjax.Trace]:
    """A slow loop at 100 Hz at each of several turbine pressures in Pa gauge, and 5 s of random levels without gas at 1
    kHz, of which the record keeps `every` so many samples; a linear duty is one between the samples of the record."""
    gas = draw_gas(rng)
    runs = [*_loops(pressures), ("lively", np.repeat(_lively_levels(rng), 2)[::every], 0.0, every * RATE)]
    return [_record_gas(unit, structure, gas, run, rng) for run in runs]


def record_run(unit: vgtjax.Actuator, rng: np.random.Generator, run: StandardRun) -> vgtjax.Trace:
    """A standard run, at its own rate."""
    pwm = run.trace().pwm
    assert pwm is not None, "a standard run has a duty"
    return _record(unit, run.kind, pwm, rng, FAULTS[0], 1 / run.rate)


def write_csv(trace: vgtjax.Trace, path: pathlib.Path) -> None:
    """A trace as a bench would hand it over, with its columns' units in their heads."""
    of = {name: channel.value for name, channel in trace.channels.items()}
    gauge = {name: 0.01 * (of[name] - trace.atmosphere) for name in ("p_act", "p_res")}
    columns = {
        "time [s]": trace.time,
        "pwm [%]": of["pwm"],
        "p_act [mbar gauge]": gauge["p_act"],
        "x_d [mm]": 1e3 * of["x_d"],
        "p_res [mbar gauge]": gauge["p_res"],
    }
    if "p_trb" in of:
        columns["p_trb [mbar gauge]"] = 0.01 * of["p_trb"]
    values = np.column_stack(list(columns.values()))
    np.savetxt(path, values, delimiter=",", comments="", fmt="%.6f", header=",".join(columns))


def _slow_loop() -> Float[np.ndarray, " time"]:
    return np.concatenate([np.zeros(50), np.linspace(0, 100, 1450), np.linspace(100, 0, 1450), np.zeros(50)])


def _loops(pressures: tuple[float, ...]) -> list[Run]:
    return [(f"loop_{pressure / 100:04.0f}mbar", _slow_loop(), pressure, LOOP_RATE) for pressure in pressures]


def _lively_levels(rng: np.random.Generator) -> Float[np.ndarray, " time"]:
    holds = rng.integers(25, 150, 100)
    return np.repeat([0.0, *np.round(rng.uniform(15, 95, 100), 1)], [50, *holds])[:2500]


def _duties(rng: np.random.Generator) -> list[tuple[str, Float[np.ndarray, " time"]]]:
    steps = [(f"step_{level:.0f}", np.repeat([0.0, level, 0.0], [200, 2000, 1800])) for level in (80.0, 100.0)]
    holds = rng.integers(120, 900, 100)
    levels = np.repeat([0.0, *np.round(rng.uniform(15, 95, 100), 1)], [150, *holds])[:10_000]
    staircase = np.repeat([0.0, 20, 35, 50, 60, 70, 60, 50, 35, 20, 0], 1200)
    return [*steps, ("levels", levels), ("staircase", staircase)]


def _record(
    unit: vgtjax.Actuator,
    name: str,
    duty: Float[np.ndarray, " time"],
    rng: np.random.Generator,
    fault: Fault,
    rate: float = RATE,
) -> vgtjax.Trace:
    time, late = np.arange(len(duty)) * rate, round(fault.delay / rate)
    applied = np.concatenate([np.full(late, duty[0]), duty[: len(duty) - late]])
    supply = _supply(time, rng)
    x_d, p_act = np.empty((2, len(duty)))
    row = numba_plant.constants(numba_plant.pack(unit))
    numba_plant.run(row, time, applied, supply, STEP, x_d, p_act)
    shown = _seen(duty, supply, (x_d, p_act), rng, fault)
    return vgtjax.Trace(time[:: fault.every], **{name: each[:: fault.every] for name, each in shown.items()}, name=name)


def _record_gas(
    unit: vgtjax.Actuator, structure: Structure, gas: Gas, run: Run, rng: np.random.Generator
) -> vgtjax.Trace:
    """One run of an actuator with a force of the exhaust gas."""
    name, duty, pressure, rate = run
    time = np.arange(len(duty)) * rate
    supply = _supply(time, rng)
    found = structured_plant.simulate(unit, structure, gas, (time, duty, supply), pressure, STEP)
    seen = _seen(duty, supply, found, rng, FAULTS[0])
    return vgtjax.Trace(time, **seen, p_trb=np.full(len(time), pressure), name=name)


def _supply(time: Float[np.ndarray, " time"], rng: np.random.Generator) -> Float[np.ndarray, " time"]:
    """Pressure of the reservoir in Pa, which a pump shakes."""
    phases = rng.uniform(0, 2 * np.pi, 2)
    return 2e4 + 150 * np.sin(2 * np.pi * 12.3 * time + phases[0]) + 300 * np.sin(0.1 * np.pi * time + phases[1])


def _seen(
    duty: Float[np.ndarray, " time"],
    supply: Float[np.ndarray, " time"],
    found: tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]],
    rng: np.random.Generator,
    fault: Fault,
) -> dict[str, Any]:
    """What sensors show of a duty, a supply, and the position and pressure that were found, a value per sample each."""
    x_d, p_act = found
    noise = _position_noise(rng, len(duty), fault)
    return {
        "pwm": duty,
        "p_res": supply + rng.normal(0, NOISE["p_act"], len(duty)),
        "x_d": x_d + rng.normal(0, NOISE["x_d"]) + noise,
        "p_act": p_act + rng.normal(0, NOISE["p_act"]) + rng.normal(0, NOISE["p_act"], len(duty)),
    }


def _position_noise(rng: np.random.Generator, count: int, fault: Fault) -> Float[np.ndarray, " time"]:
    noise = rng.normal(0, NOISE["x_d"], count)
    if fault.low_pass is not None:
        keep = np.exp(-2 * np.pi * fault.low_pass * RATE)
        noise = scipy.signal.lfilter([1 - keep], [1, -keep], noise)
        noise *= NOISE["x_d"] / np.std(noise)
    far = rng.random(count) < fault.outliers
    return noise + far * 30 * NOISE["x_d"] * rng.choice([-1, 1], count)
