"""What closed loops were worth, one by one and for all plants together."""

import dataclasses
import math
import time
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from vgtjax.control import (
    AbstractController,
    ClosedLoop,
    Margins,
    Reference,
    Scenario,
    StepAnswer,
    WithFallback,
    channels_used,
    close_loop,
    replay,
)
from vgtjax.plants import AbstractModel
from vgtjax.tuning import Cases, ClosedLoops, Sliding, sliding

from ..fmu.cost import SampleCost
from ..output.closed_loops import ERRORS, Summaries, along_each, of_plants
from ..output.files import finite
from ..output.margins import list_margins
from ..output.sliding import list_sliding, warnings
from .job import ControlJob

CHANNELS = {
    "position": "position",
    "pressure": "chamber pressure",
    "reservoir": "reservoir pressure",
    "turbine": "turbine pressure",
}
"""What a controller may measure, in words."""
PROBED = 0.5
"""s of a run by which it is found out what a controller measures, and how long it takes."""
SUMMARIES: Summaries = {
    **ERRORS,
    "pressure_median": ("pressure_rms", np.median),
    "pressure_worst": ("pressure_rms", np.max),
    "effort": ("effort", np.median),
    "chatter": ("chatter", np.median),
}
"""What is told of the plants along a reference."""
REPEATS = 5
"""Times that it is timed; the shortest counts, as other programs only ever lengthen one."""


@dataclasses.dataclass(frozen=True, eq=False)
class Outcome:
    """Closed loops, those that ran for one time together, and what the controller measures and takes.

    `margins` are those of each plant's loop where its rod slides up and down.
    """

    groups: tuple[ClosedLoops, ...]
    margins: dict[str, dict[str, Margins]]
    sliding: Sliding | None
    """How far an observer that switches slides in all closed loops."""
    measures: tuple[str, ...]
    sample_seconds: float
    sample: SampleCost | None
    """Of the first plant's controller in C, where it can be written."""
    seconds: float

    @property
    def loops(self) -> list[tuple[ClosedLoops, int]]:
        """Every closed loop: its group, and its place there."""
        return [(group, index) for group in self.groups for index in range(len(group))]

    def figure(self, name: str) -> Float[np.ndarray, " loops"]:
        """Of every closed loop, e.g. its `rms`."""
        return np.concatenate([getattr(group, name) for group in self.groups])


def slides(job: ControlJob, groups: tuple[ClosedLoops, ...]) -> Sliding | None:
    """Whether an observer that switches slides in the closed loops of a job; nothing without one."""
    inside = {
        name: each.controller if isinstance(each, WithFallback) else each for name, each in job.controllers.items()
    }
    judged = zip(job.groups, groups, strict=True)
    return sliding(inside, *judged, settled=job.study.control.settled)


def look_at(controller: AbstractController, cases: Cases) -> tuple[tuple[str, ...], float]:
    """Channels that a controller uses in the first of some closed loops, and seconds that a sample takes, compiled."""
    plant, scenario = jax.tree.map(lambda leaf: leaf[0], (cases.plants, cases.scenarios))
    reference = jax.tree.map(lambda leaf: leaf[: max(1, round(PROBED / cases.period)) + 1], scenario.reference)
    run = _run(plant, controller, scenario, reference, cases.period)
    given = (controller, run.measured, run.reference, cases.period)
    used, spent = channels_used(*given), []
    for _ in range(REPEATS):
        began = time.perf_counter()
        jax.block_until_ready(replay(*given))
        spent.append(time.perf_counter() - began)
    return used, min(spent) / len(run.time)


def _run(
    plant: AbstractModel, controller: AbstractController, scenario: Scenario, reference: Reference, period: float
) -> ClosedLoop:
    short = dataclasses.replace(scenario, reference=reference)
    return close_loop(plant, controller, short, (len(reference.position) - 1) * period, period=period, throw=False)


def summarise(job: ControlJob, outcome: Outcome) -> dict[str, Any]:
    """The content of `summary.json`; SI units, what counts from `settled` on."""
    return {
        "design": job.study.control.design,
        "gains": {gain.name: gain.value for gain in job.gains},
        "belief": job.belief,
        "measures": [CHANNELS[channel] for channel in outcome.measures],
        "settled": job.study.control.settled,
        "seconds_per_sample": outcome.sample_seconds,
        "sample": None if outcome.sample is None else dataclasses.asdict(outcome.sample),
        "worst": {name: finite(np.fmax.reduce(outcome.figure(name))) for name in ("rms", "peak", "pressure_rms")},
        "loops": [_numbers(group, index) for group, index in outcome.loops],
        "sliding": list_sliding(outcome.sliding),
        "margins": list_margins(outcome.margins),
        "failed": [str(group.labels[index]) for group, index in outcome.loops if group.failed[index]],
        "failure": next((group.failure for group in outcome.groups if group.failure), None),
        "notes": [*job.notes, *warnings(outcome.sliding)],
        **job.account(outcome.seconds),
    }


def _numbers(group: ClosedLoops, index: int) -> dict[str, Any]:
    label, answers = group.labels[index], group.answers[index]
    figures = {name: getattr(group, name)[index] for name in ("rms", "peak", "pressure_rms", "effort", "chatter")}
    return {
        **dataclasses.asdict(label),
        **finite(figures),
        "settling_time": finite(_worst(answers, "settling_time")),
        "overshoot": finite(_worst(answers, "overshoot")),
        "failed": bool(group.failed[index]),
    }


def _worst(answers: list[StepAnswer], name: str) -> float:
    """Of all steps; NaN without a step."""
    return max((getattr(answer, name) for answer in answers), default=math.nan)


def tabulate(outcome: Outcome) -> list[dict[str, Any]]:
    """A row for every reference and turbine pressure: the middle and the worst of the plants, in SI units.

    `None` where nothing is to be said; a `settling_time` is infinite where a plant does not come there.
    """
    rows = []
    for group in outcome.groups:
        for head, mine in along_each(group.labels):
            steps = [answer for i in mine for answer in group.answers[i]]
            settling = _worst(steps, "settling_time") if steps else None
            answered = {"settling_time": settling, "overshoot": finite(_worst(steps, "overshoot"))}
            rows.append(head | of_plants(group, mine, SUMMARIES) | answered)
    return rows
