"""Closed loops of given controllers, run and judged without tuning anything."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._lanes import map_rows
from .._printing import Cells, Printed
from ..control import AbstractController, StepAnswer, step_answers
from ._cases import Case, Cases
from ._loops import LANES, MEASURES, Figures, LoopParts, Timing, figures_of, rows_of, run_loop


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

    def at(self, places: Sequence[int]) -> "Runs":
        """Those of the closed loops at some places."""
        names = ("reference", "position", "pressure", "duty", *(["observed"] if self.observed is not None else []))
        return dataclasses.replace(self, **{name: getattr(self, name)[list(places)] for name in names})


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ClosedLoops(Figures, Printed):
    """Closed loops and what each was worth from `settled` seconds on. Prints itself as a table.

    `answers` are those to the steps of each reference.
    """

    labels: tuple[Case, ...]
    runs: Runs
    settled: float

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

    def where(
        self,
        *,
        plant: str | None = None,
        reference: str | None = None,
        turbine_pressure: float | None = None,
        variant: str | None = None,
    ) -> "ClosedLoops":
        """Those with these names: `loops.where(plant="stiffer", reference="sine").rms`.

        **Raises:** `InputError` where there is none.
        """
        names = {"plant": plant, "reference": reference, "turbine_pressure": turbine_pressure, "variant": variant}
        wanted = {name: value for name, value in names.items() if value is not None}
        places = [i for i, at in enumerate(self.labels) if all(getattr(at, name) == wanted[name] for name in wanted)]
        if not places:
            said = " and ".join(f"{name} {value!r}" for name, value in wanted.items())
            known = {name: sorted({getattr(label, name) for label in self.labels}) for name in wanted}
            ours = "; ".join(f"{name} is one of {', '.join(map(repr, each))}" for name, each in known.items())
            raise InputError(f"no closed loop has {said}; {ours}")
        figures = {name: getattr(self, name) for name in (*MEASURES, "result")}
        chosen = jax.tree.map(lambda leaf: leaf[np.asarray(places)], figures)
        labels = tuple(self.labels[i] for i in places)
        return dataclasses.replace(self, **chosen, labels=labels, runs=self.runs.at(places))

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
    cases.require_longer(settled)
    timing, at, count = Timing(cases.duration, cases.period), rows_of(controllers, cases), len(cases)
    signals, figures = map_rows(lambda rows: _close(timing, settled, rows), at, count, min(lanes, count))
    runs = Runs(np.arange(signals[0].shape[1]) * cases.period, *signals)
    return ClosedLoops(**figures, labels=cases.labels, runs=runs, settled=settled)


@eqx.filter_jit
def _close(timing: Timing, settled: float, rows: LoopParts) -> tuple[tuple[Array | None, ...], dict[str, Any]]:
    """Signals and figures of every row."""

    def lane(*row: Any) -> tuple[tuple[Array | None, ...], dict[str, Any]]:
        run = run_loop(row, timing)
        signals = (run.reference.position, run.position, run.pressure, run.duty, run.observed("pressure"))
        return signals, figures_of(run, settled)

    return jax.vmap(lane)(*rows)
