"""Gains of adaptive backstepping, found on plants of a population, and what they are worth on others."""

import functools
import itertools
import pathlib
from typing import Any

import jax
import numpy as np

import vgtjax
from vgtjax.control import AbstractController, AdaptiveBackstepping, Sine, Steps
from vgtjax.parts import OPERATING_POINTS
from vgtjax.tuning import Objective, Tuning, cross_cases, gain_names, tune

from ..kept import KeptRows
from ..table import Section
from .unknown_plants import ANSWER, JUMP, RISE, Course, Surroundings, cells, draw, follow

PLANTS = 25
"""On which gains are judged, each with the noise of its own sensors."""
TUNED_ON = 4
SEEDS = (181, 182)
"""Of the plants that gains are tuned on, and of those on which they are judged."""
REFERENCES = {
    "sine": Sine(0.003, 1.5, 0.005),
    "steps": Steps(np.array([1.0, 2.5, 4.0]), np.array([0.003, 0.008, 0.005]), initial=0.002, rise=0.5),
}
SECONDS, SETTLED = 5.0, 1.0
OBJECTIVE = Objective(tracking=1e-5, chatter=5.0, settled=SETTLED)
SLOW = ("observer.adaptation",)
"""Not tuned: coefficients of friction are learned over minutes, of which runs of some seconds say nothing."""
BOUNDS = {"pressure_gain": (10.0, None)}
"""Below it little is won, and what is learned of the flow map swings."""
LASTING = 20.0
"""s along Signal 1: up to its highest point and past it."""
FORMER: dict[str, float | tuple[float, ...]] = {
    "position_gain": 150.0,
    "velocity_gain": 300.0,
    "pressure_gain": 27.0,
    "position_weight": 64.0,
    "pressure_weight": 2e-10,
    "load_gain": 1200.0,
    "drift_gain": 270.0,
    "observer.injection": (0.01, 0.01),
    "observer.adaptation": 0.3,
    "differentiator.largest_second_derivative": 8.0,
}
"""Gains that were searched for where fits say that a rod has up to 3 kg and a fifth of the printed damping."""
FORMER_HELD: dict[str, float | tuple[float, ...]] = {
    "forgetting_time": 0.1,
    "observer.start": (1.0, 0.2, 0.2),
    "observer.least": 0.04,
    "observer.largest": 1.2,
}
"""What was not tuned: among it where coefficients of friction began and were held for these fits."""
COURSES = (
    *(Course("Signal 1", pressure) for pressure in OPERATING_POINTS),
    Course("Signal 1", 3e5, 33.0),
    Course("Signal 1", 3e5, late=True),
    *(Course("Signal 2", pressure) for pressure in (0.0, 3e5)),
    Course("Signal 2", 3e5, late=True),
    *(Course("Signal 2", pressure, rise=JUMP) for pressure in (0.0, 3e5)),
    Course("Signal 2", 3e5, late=True, rise=JUMP),
)


def measure(keep: pathlib.Path | None = None) -> Section:
    """Finds the gains once more, and tries the former and the shipped ones on other plants.

    **Arguments:** `keep`: a file for finished rows, from which another call goes on.
    """
    columns = ("course", "gains", "RMS error", "worst", "peak", "overshoot", "duty's chatter")
    section = Section("Gains of adaptive backstepping", _ABOUT, columns)
    shipped = AdaptiveBackstepping()
    kept = KeptRows(keep, f"{_ABOUT}{_said(shipped)}")
    judged = {"former": vgtjax.replace_parameters(shipped, FORMER | FORMER_HELD), "shipped": shipped}
    for course, (name, controller) in itertools.product(COURSES, judged.items()):
        row = kept.row(f"{course}, {name}", functools.partial(_row, controller, course))
        section.add(str(course), name, *row)
    section.notes += [*kept.row("found", _found), f"Shipped: {_said(shipped)}."]
    return section


def _row(controller: AbstractController, course: Course) -> tuple[str, ...]:
    seconds = 0.0 if course.name == "Signal 2" else LASTING
    around = Surroundings.alike(PLANTS, course.delay)
    *errors, _, _, chatter = cells(course, follow(controller, draw(PLANTS, SEEDS[1]), around, course, seconds))
    return *errors, chatter


def _found() -> tuple[str, ...]:
    found = find()
    before, after = found.progress.history[0], found.progress.cost
    return (f"Found: {_said(found.controller)}.", f"Their cost on the plants tuned on: {after:.3g}, from {before:.3g}.")


def find() -> Tuning:
    """Gains by the tuner, from the former ones."""
    start = vgtjax.replace_parameters(AdaptiveBackstepping(), FORMER)
    drawn = draw(TUNED_ON, SEEDS[0])
    plants = {f"plant {i}": jax.tree.map(lambda leaf, i=i: leaf[i], drawn) for i in range(TUNED_ON)}
    return tune(
        start, cross_cases(plants, REFERENCES, OPERATING_POINTS, duration=SECONDS), OBJECTIVE, fixed=SLOW, bounds=BOUNDS
    )


def _said(controller: AbstractController) -> str:
    values: dict[str, Any] = {name: vgtjax.get_parameter(controller, name) for name in gain_names(controller)}
    return ", ".join(f"{name} {' and '.join(f'{v:.3g}' for v in np.ravel(value))}" for name, value in values.items())


_ABOUT = (
    f"Adaptive backstepping on the printed design model; it measures position (8 um of noise) and chamber pressure "
    f"(60 Pa). Tuned on {TUNED_ON} plants of the population of the benchmark of unknown plants, a sine and steps at 0, "
    f"1500 and 3000 mbar, and judged on {PLANTS} others along other references, as it is there. The former gains were "
    "searched for on fits that move up to 3 kg under a fifth of the printed damping. Middle and worst of the plants. "
    f"Errors along Signal 2 count from {ANSWER:g} s after its step on, which takes {RISE:g} s or is the printed jump."
)
