"""How often the intervals of the units of a fleet hold the truth, and whether the units' spread comes out."""

import time

import numpy as np
import scipy.stats

import vgtjax
from vgtjax import SimulationError
from vgtjax.estimation import run_together
from vgtjax.identification import identify
from vgtjax.plants import AbstractRodModel
from vgtjax.population import population_of_fits

from ..campaigns import FLEETS, Fleet, draw_unit, record_fleet
from ..table import Section
from .coverage import counted_entries, fitting, scores_of

UNITS = 20
"""Of each fleet."""
SEED = 2012
SPREADS = ("diaphragm.mass", "friction.viscous_damping", "diaphragm.stiffness", "friction.coulomb_force")
"""What a bench should tell of how units differ."""


def measure() -> Section:
    """Fits every unit as the command line would, and the population of what came out."""
    section = Section(
        "Do the intervals of a fleet's units hold the truth, and is their spread found?",
        f"{UNITS} actuators a fleet, simulated by the hard-switching plant of these benchmarks (RK4, 10 us); slow "
        "loops of 30 s at 100 Hz each, and in one fleet random levels of 5 s at 500 Hz; all that a study frees by "
        "default is fitted, with exhaust gas from what `identify` finds, and nothing is said of how the duty was held.",
        (
            "records",
            "hold the truth",
            "determined",
            "failed",
            *(f"spread of {name.partition('.')[2]}" for name in SPREADS),
            "each",
        ),
    )
    for number, fleet in enumerate(FLEETS):
        section.add(*_measure(fleet, SEED + number))
    section.notes.append(
        "Hold the truth: of the entries that are determined; of the vane force nothing is counted. Spread: standard "
        "deviation between units, freed of the errors of the fits, over the true one; of twenty units one is itself "
        "known to a sixth. Each: wall time of a unit's records and fit, as many side by side as there are cores."
    )
    return section


def _measure(fleet: Fleet, seed: int) -> tuple[str, ...]:
    """A row of the table."""
    rng, began = np.random.default_rng(seed), time.perf_counter()
    units = [draw_unit(rng) for _ in range(UNITS)]
    found: dict[int, vgtjax.Calibration] = {}

    def finished(number: int, calibration: vgtjax.Calibration | SimulationError) -> None:
        if not isinstance(calibration, SimulationError):
            found[number] = calibration

    records = [record_fleet(unit, rng, fleet) for unit in units]
    starts = [_start(traces) if fleet.pressures else vgtjax.Actuator() for traces in records]
    fits = {number: fitting(*each) for number, each in enumerate(zip(records, starts, strict=True))}
    run_together(fits, finished)
    seconds = (time.perf_counter() - began) / UNITS
    errors = np.array([_scores(calibration, units[number]) for number, calibration in sorted(found.items())])
    known = np.isfinite(errors)
    held = np.abs(errors[known]) <= scipy.stats.norm.ppf(0.975)
    return (
        fleet.name,
        f"{100 * np.mean(held):.1f} %",
        f"{100 * np.mean(known):.0f} %",
        str(UNITS - len(found)),
        *_spreads(list(found.values()), units),
        f"{seconds:.1f} s",
    )


def _start(traces: list[vgtjax.Trace]) -> AbstractRodModel:
    """What identification leaves of the printed actuator, with a force on the vanes that changes sides with speed."""
    model: AbstractRodModel = vgtjax.Actuator(vane_force=vgtjax.SpeedMap())
    for moved, _ in identify(model, traces):
        model = moved
    return model


def _scores(found: vgtjax.Calibration, unit: vgtjax.Actuator) -> np.ndarray:
    """Errors in standard errors, NaN where the traces do not determine a value; of the vane force, which is another
    law, nothing is counted."""
    return np.where(found.determined[counted_entries(found, unit)], scores_of(found, unit), np.nan)


def _spreads(found: list[vgtjax.Calibration], units: list[vgtjax.Actuator]) -> list[str]:
    """Spread of units by a fleet's fits over the true one."""
    population = population_of_fits(found)
    relative = dict(zip(population.factors.entries, population.deviations / population.nominal, strict=True))
    cells = []
    for name in SPREADS:
        values = np.array([float(vgtjax.get_parameter(unit, name)) for unit in units])
        cells.append(f"{relative.get(name, 0.0) / (np.std(values, ddof=1) / np.mean(values)):.2f}")
    return cells
