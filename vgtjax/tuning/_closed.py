"""Closed loops of given controllers, run and judged without tuning anything."""

import dataclasses
import functools
from collections.abc import Mapping

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._lanes import map_rows
from .._printing import Cells, Printed
from ..control import (
    AbstractController,
    Scenario,
    StepAnswer,
    chatter,
    close_loop,
    effort,
    pressure_peak,
    pressure_rms,
    sliding_share,
    step_answers,
    tracking_peak,
    tracking_rms,
)
from ..plants import AbstractModel
from ..simulation import RESULTS, HasEnds
from ._cases import Case, Cases, stack_trees
from ._loops import Timing
from ._problem import LANES


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Runs:
    """Signals of closed loops, at their samples; true ones but for `observed`, the controller's own chamber pressure.

    `time` in s, `reference` and `position` in m, `pressure` and `observed` in Pa absolute, `duty` in percent.
    `observed` is `None` for a controller that observes none.
    """

    time: Float[np.ndarray, " time"]
    reference: Float[np.ndarray, "cases time"]
    position: Float[np.ndarray, "cases time"]
    pressure: Float[np.ndarray, "cases time"]
    duty: Float[np.ndarray, "cases time"]
    observed: Float[np.ndarray, "cases time"] | None


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoops(HasEnds, Printed):
    """Closed loops and what each was worth from `settled` seconds on. Prints itself as a table.

    `rms` and `peak` of the true error are in m, `pressure_rms` and `pressure_peak` of the observed pressure in Pa (NaN
    where none is observed), `effort` and `chatter` in percent of duty, as [`effort`][] and [`chatter`][] have them;
    `sliding` is the share of samples at which the observer slides as [`sliding_share`][] has it. `result` says of each
    run how it ended; figures of one that failed are NaN. `answers` are those to the steps of each reference.
    """

    labels: tuple[Case, ...]
    runs: Runs
    settled: float
    rms: Float[np.ndarray, " cases"]
    peak: Float[np.ndarray, " cases"]
    pressure_rms: Float[np.ndarray, " cases"]
    pressure_peak: Float[np.ndarray, " cases"]
    sliding: Float[np.ndarray, " cases"]
    effort: Float[np.ndarray, " cases"]
    chatter: Float[np.ndarray, " cases"]
    result: RESULTS

    def __len__(self) -> int:
        return len(self.labels)

    @functools.cached_property
    def answers(self) -> list[list[StepAnswer]]:
        """To every step of the reference of each closed loop; none of a run that failed."""
        runs = self.runs
        return [
            [] if failed else step_answers(runs.time, reference, position)
            for failed, reference, position in zip(self.failed, runs.reference, runs.position, strict=True)
        ]

    def _title(self) -> str:
        return f"{len(self)} closed loops from {self.settled:g} s on, {np.sum(self.failed)} failed"

    def _tables(self) -> list[Cells]:
        head = ("closed loop", "RMS um", "peak um", "pressure RMS Pa", "effort %", "chatter %")
        columns = (1e6 * self.rms, 1e6 * self.peak, self.pressure_rms, self.effort, self.chatter)
        rows = [(str(label), *(_cell(column[i]) for column in columns)) for i, label in enumerate(self.labels)]
        return [[head, *rows]]


def _cell(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else ""


def close_loops(
    controllers: AbstractController | Mapping[str, AbstractController],
    cases: Cases,
    *,
    settled: float = 2.0,
    lanes: int = LANES,
) -> ClosedLoops:
    """Closes the loop of every case, as it is, and judges it from `settled` seconds on.

    **Arguments:**

    - `controllers`: one for all cases, or one for each plant by its name; all of one structure.
    - `lanes`: closed loops that run side by side; memory grows with it.

    **Raises:** `InputError` for a plant that has no controller, controllers of other structures, or a time that a run
    does not reach.
    """
    if not 0 <= settled < cases.duration:
        raise InputError(
            f"settled must be zero or more and before the end of runs after {cases.duration:g} s, but it is "
            f"{settled:g} s; correct it"
        )
    given = controllers if isinstance(controllers, Mapping) else {label.plant: controllers for label in cases.labels}
    missing = [label.plant for label in cases.labels if label.plant not in given]
    if missing:
        raise InputError(f"every plant needs a controller, but '{missing[0]}' has none; give it one")
    stacked = stack_trees([given[label.plant] for label in cases.labels], "controllers")

    def at(places: np.ndarray) -> tuple[AbstractController, AbstractModel, Scenario]:
        chosen = cases.take(places.tolist())
        return jax.tree.map(lambda leaf: leaf[places], stacked), chosen.plants, chosen.scenarios

    timing = Timing(cases.duration, cases.period)
    count = len(cases)
    signals, figures, result = map_rows(lambda rows: _close(timing, settled, *rows), at, count, min(lanes, count))
    blank = np.where(result == RESULTS.successful, 1.0, np.nan)
    runs = Runs(np.arange(signals[0].shape[1]) * cases.period, *signals)
    return ClosedLoops(cases.labels, runs, settled, **{n: v * blank for n, v in figures.items()}, result=result)


@eqx.filter_jit
def _close(
    timing: Timing, settled: float, controllers: AbstractController, plants: AbstractModel, scenarios: Scenario
) -> tuple[tuple[Array | None, ...], dict[str, Array], RESULTS]:
    """Signals and figures of every lane, and how it ended."""

    def lane(controller: AbstractController, plant: AbstractModel, scenario: Scenario) -> tuple:
        run = close_loop(plant, controller, scenario, timing.duration, period=timing.period, throw=False)
        signals = (run.reference.position, run.position, run.pressure, run.duty, run.log.get("pressure"))
        figures = {name: measure(run, settled) for name, measure in MEASURES.items()}
        return signals, figures, run.result

    return jax.vmap(lane)(controllers, plants, scenarios)


MEASURES = {
    "rms": tracking_rms,
    "peak": tracking_peak,
    "pressure_rms": pressure_rms,
    "pressure_peak": pressure_peak,
    "sliding": sliding_share,
    "effort": effort,
    "chatter": chatter,
}
"""By the name that each has among the figures of [`ClosedLoops`][]."""
