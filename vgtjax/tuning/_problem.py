"""Gains as coordinates, and the cost of all closed loops with its derivatives."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from .._errors import InputError
from .._lanes import map_rows
from ..control import AbstractController, ClosedLoop, check
from ..parameters import Selection, Transform, build_transform, parameter_table, select
from ._admissible import MARGIN, conditions, gain_names, spare, spare_slopes
from ._cases import Cases
from ._loops import LANES, Figures, Lane, Shared, Timing, evaluate_lanes, linearise_lanes, simulate_lanes
from ._objective import Objective

MEMORIES = (math.inf, 1.0, 0.3, 0.1, 0.03)
"""s; all that a gain changes, and what it changes within a second and less."""


@dataclasses.dataclass(frozen=True, eq=False)
class CaseCosts(Figures):
    """What every closed loop costs: `terms` are the summands of its cost `l`, NaN of a run that failed."""

    terms: Float[np.ndarray, "cases terms"]

    @property
    def costs(self) -> Float[np.ndarray, " cases"]:
        """`l` of every closed loop."""
        return self.terms.sum(1)


@dataclasses.dataclass(frozen=True, eq=False)
class Linearisation:
    """Costs, and their first and Gauss-Newton's second derivatives with respect to the coordinates."""

    cases: CaseCosts
    slopes: Float[np.ndarray, "cases gains"]
    curvatures: Float[np.ndarray, "cases gains gains"]

    @property
    def finite(self) -> Bool[np.ndarray, " cases"]:
        """Whose derivatives are finite; those of a chaotic run may overflow while it does not."""
        return np.isfinite(self.slopes).all(1) & np.isfinite(self.curvatures).all((1, 2))


@dataclasses.dataclass(frozen=True, eq=False)
class TuningProblem:
    """A controller whose gains are to be chosen for many closed loops.

    `selection` says which gains are free, `transform` how they move. Made by [`plan_tuning`][].
    """

    controller: AbstractController
    cases: Cases
    objective: Objective
    selection: Selection
    transform: Transform
    memories: tuple[float, ...] = MEMORIES
    lanes: int = LANES

    @property
    def start(self) -> Float[np.ndarray, " gains"]:
        """Coordinates of the controller as it was given."""
        return np.asarray(self.transform.to_coordinates(self.selection.values(self.controller)))

    def controller_at(self, coordinates: Float[np.ndarray, " gains"]) -> AbstractController:
        """The controller with the gains of some coordinates.

        **Raises:** `InputError` for gains that break a condition of the design.
        """
        tuned = self.selection.unpack(self.controller, self.transform.to_physical(jnp.asarray(coordinates)))
        check(tuned)
        return tuned

    def evaluate(self, coordinates: Float[np.ndarray, " gains"]) -> CaseCosts:
        """What every closed loop costs."""
        return self.evaluate_all(coordinates[None])[0]

    def evaluate_all(self, candidates: Float[np.ndarray, "candidates gains"]) -> list[CaseCosts]:
        """The same of several candidates side by side, which takes less time than one after the other."""
        count = len(self.cases)
        places = np.tile(np.arange(count), len(candidates))
        figures, *_ = self._gather(evaluate_lanes, places, np.repeat(candidates, count, 0), math.inf)
        parts = [slice(begin, begin + count) for begin in range(0, len(places), count)]
        return [CaseCosts(**jax.tree.map(lambda leaf, part=part: leaf[part], figures)) for part in parts]

    def linearise(
        self, coordinates: Float[np.ndarray, " gains"], memory: float | Float[np.ndarray, " cases"] = math.inf
    ) -> Linearisation:
        """The same with derivatives, forward through every closed loop, that remember `memory` seconds, of each."""
        places = np.arange(len(self.cases))
        repeated = np.repeat(coordinates[None], len(places), 0)
        figures, slopes, curvatures = self._gather(linearise_lanes, places, repeated, memory)
        return Linearisation(CaseCosts(**figures), slopes, curvatures)

    def simulate(self, coordinates: Float[np.ndarray, " gains"], indices: Sequence[int]) -> ClosedLoop:
        """Runs of some cases; every array has a leading axis of them."""
        chosen = self.cases.take(indices)
        return simulate_lanes(self.controller_at(coordinates), chosen.plants, chosen.scenarios, self._timing)

    def combine(self, costs: Float[np.ndarray, " cases"]) -> float:
        """`J` of the costs of all closed loops; infinite where one of them is not finite."""
        return float(self.objective.combine(jnp.asarray(costs))) if np.all(np.isfinite(costs)) else np.inf

    def cost(self, coordinates: Float[np.ndarray, " gains"]) -> float:
        """`J`, as an optimiser without derivatives would ask for it."""
        return self.combine(self.evaluate(coordinates).costs)

    def conditions(self, coordinates: Float[np.ndarray, " gains"]) -> Float[np.ndarray, " conditions"]:
        """How far inside each condition of the design, less [`MARGIN`][]; negative is not admissible."""
        return np.asarray(spare(self.controller, self.selection, self.transform, coordinates))

    def condition_slopes(self, coordinates: Float[np.ndarray, " gains"]) -> Float[np.ndarray, "conditions gains"]:
        """Derivatives of these."""
        return np.asarray(spare_slopes(self.controller, self.selection, self.transform, coordinates))

    def at_bound(self, coordinates: Float[np.ndarray, " gains"]) -> Bool[np.ndarray, " gains"]:
        """Which gains are at an end of what they may be."""
        return np.asarray(self.transform.at_bound(jnp.asarray(coordinates)))

    def moves_errors(self, coordinates: Float[np.ndarray, " gains"]) -> Bool[np.ndarray, " gains"]:
        """Which gains move any error of any closed loop; others could be anything. Of softened closed loops."""
        # A short memory: derivatives of a longer one may overflow, and what has done so all the same says nothing.
        found = self.linearise(coordinates, min(self.memories))
        return np.diag(found.curvatures[found.finite].sum(0)) > 0

    @property
    def _timing(self) -> Timing:
        return Timing(self.cases.duration, self.cases.period)

    def _gather(
        self,
        function: Any,
        places: Int[np.ndarray, " rows"],
        coordinates: Float[np.ndarray, "rows gains"],
        memory: float | Float[np.ndarray, " rows"],
    ) -> tuple:
        """Runs the cases at some places, `lanes` of them side by side."""
        count = len(places)
        memories = np.broadcast_to(np.asarray(memory, float), count)
        shared = Shared(self.controller, self.selection, self.transform, self.objective, self._timing)

        def at(chosen: np.ndarray) -> Lane:
            chunk = self.cases.take(places[chosen].tolist())
            return Lane(chunk.plants, chunk.scenarios, coordinates[chosen], memories[chosen])

        return map_rows(functools.partial(function, shared), at, count, min(self.lanes, count))


def plan_tuning(
    controller: AbstractController,
    cases: Cases,
    objective: Objective,
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    bounds: dict[str, tuple[float | None, float | None]] | None = None,
    memories: Sequence[float] = MEMORIES,
    lanes: int = LANES,
) -> TuningProblem:
    """Which gains move, and how.

    **Arguments:**

    - `free`, `fixed`: names or fnmatch patterns of the controller's parameters, e.g. `observer.*_rate`; `None` frees
      all that are not held, but for what the controller believes of the plant.
    - `bounds`: ends of single gains by name, `None` for none.
    - `memories`: s, each a `derivative_memory` of [`close_loop`][]; infinite is exact. Each closed loop uses the
      longest whose derivatives are informative.
    - `lanes`: closed loops that run side by side; memory grows with it.

    **Raises:** `InputError` for a name that matches nothing, a start outside its bounds, a start that breaks a
    condition of the design, when no gain is left to tune, or for runs that are over before the objective counts.
    """
    chosen = gain_names(controller) if free is None else free
    selection = select(controller, free=chosen, fixed=fixed)
    if not selection.entries:
        raise InputError("tuning needs at least one free gain, but free and fixed leave none; free one", "free")
    table, start = parameter_table(controller), selection.values(controller)
    transform = build_transform(table, selection.entries, start, bounds or {})
    problem = TuningProblem(
        controller, cases, objective, selection, transform, tuple(sorted(memories, reverse=True)), lanes
    )
    spares = problem.conditions(problem.start)
    for (name, value), left in zip(conditions(controller).items(), spares, strict=True):
        if left < 0:
            raise InputError(
                f"the start must keep every condition of the design with {MARGIN:.1%} to spare, but '{name}' has "
                f"{float(value):.2%}; change the start values",
                "controller",
            )
    cases.require_longer(objective.settled)
    return problem
