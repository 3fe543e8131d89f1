"""Where a fit stands: all that a file must keep of it for another run to go on exactly."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import NamedTuple

CHI2_TOLERANCE = 0.01
"""A fit has converged when a step lowers chi^2 by less, or another one promises no more: a move of a tenth of a
standard error in any one direction."""
STALL_TOLERANCE = 0.1
"""A fit has also converged when all moves by one Jacobian lower chi^2 by less than this. Kinks of the model (a plunger
that grazes its seat, a rod that sticks) leave a linear gain that no step reaches: on the slow loops of an actuator,
the steps after such a stall gained 0.3 of 18000 in sum, in 20 trials."""
MAX_ITERATIONS = 100
LENGTHS = (2.0, 0.5, 30.0)
"""Largest move of a coordinate by one trial, and those of searches that begin again since one got stuck. Without any,
units of a fleet took 29, 6, 9, 29, 6 and 12 Jacobians, and one was lost where friction shakes the rod; with the first
they take 4 to 8. Bristles of an axis whose misfit is 2000 times the noise end well by the last only."""


class StartEnded(NamedTuple):
    """Where the search from one start ended: the cost, `None` where a simulation failed, and how."""

    cost: float | None
    steps: int
    status: str


@dataclasses.dataclass(frozen=True)
class Progress:
    """Where a fit stands after a step; enough to resume it exactly.

    A search is followed by corrections, in full linear steps, for what it tells of sensors and of numerical errors.
    """

    coordinates: tuple[float, ...]
    """Where it stands, in coordinates of the transform."""
    step_size: float = 1.0
    """Inverse of the damping."""
    longest: float = LENGTHS[0]
    """How far a trial may move a coordinate."""
    began: tuple[float, ...] = ()
    """Where the search began."""
    iteration: int = 0
    """Steps: each is all moves by one Jacobian."""
    accepted: int = 0
    """Moves that lowered the cost, and corrections."""
    rejected: int = 0
    """How often no trial lowered the cost."""
    failed: int = 0
    """Trials whose simulation failed."""
    converged: bool = False
    """Whether the search has ended where another step promises nothing, or gained next to nothing."""
    stalled: bool = False
    """Whether it converged since all trials of its last step gained less than `STALL_TOLERANCE`."""
    stuck: bool = False
    """Whether no trial of the last step lowered the cost by more than rounding."""
    given_up: bool = False
    """Whether the task has a `ceiling` of the cost to which the steps would not have come down."""
    history: tuple[float, ...] = ()
    """The cost (half the mean squared residual in units of the noise) after every iteration, the start first."""
    corrections: int = 0
    """How many corrections there were."""
    settled: bool = False
    """Whether the next one would move nothing that matters."""
    found: tuple[float, ...] = ()
    """Where the search ended, before its corrections."""
    wanted: tuple[tuple[float, ...], ...] = ()
    """The full linear steps from `found` on."""
    linearised: tuple[float, ...] = ()
    """Where the derivatives are from that corrections take."""
    around: tuple[tuple[float, ...], ...] = ()
    """Places around there over which these are means; none before corrections have settled once."""
    held: tuple[int, ...] = ()
    """Numbers of coordinates that ran away, and are held at their start since."""
    let_go: float | None = None
    """The least cost before that."""
    lost: bool = False
    """Whether holding them made the fit worse."""
    linear: tuple[float, ...] = ()
    """Sample intervals in s of traces whose duty was found to be linear between samples."""
    hold_decided: bool | None = None
    """Whether that, or that it was held, is the only explanation of the slowest ones; `None` before it was asked."""
    late: bool = False
    """Whether the delay of the duty is free."""
    edges: tuple[tuple[float, ...], ...] = ()
    """Samples by which the edges of the duty of every trace are late, beside that delay, where their times are free."""
    edges_seen: tuple[float, ...] = ()
    """The coordinates at which it was seen what these edges move."""
    otherwise: tuple[float, ...] | None = None
    """Where a fit of slow traces ends that reads their duty the other way, held or linear, and meets them as well;
    empty where it does not, `None` before it was asked."""
    finer: bool = False
    """Whether no trace has longer steps than others."""
    waterfall: tuple[tuple[float | None, int, str], ...] = ()
    """The end of every start, where there were several, the given one first."""

    @property
    def ends(self) -> tuple[StartEnded, ...]:
        """The waterfall by name."""
        return tuple(StartEnded(*each) for each in self.waterfall)

    def corrected(
        self, coordinates: Iterable[float], wanted: Iterable[float], linearised: Iterable[float]
    ) -> "Progress":
        """After a correction that leads to these coordinates, whose cost is not known yet."""
        return dataclasses.replace(
            self,
            coordinates=tuple(coordinates),
            found=self.found if self.corrections else self.coordinates,
            wanted=(*self.wanted, tuple(wanted)) if self.corrections else (),
            iteration=self.iteration + 1,
            accepted=self.accepted + 1,
            corrections=self.corrections + 1,
            linearised=tuple(linearised),
        )

    def linearised_around(self, places: Iterable[Iterable[float]]) -> "Progress":
        """Where it is, with derivatives of there, and of these places around."""
        return dataclasses.replace(self, linearised=self.coordinates, around=tuple(map(tuple, places)))

    def holding(self, numbers: Iterable[int], coordinates: Iterable[float]) -> "Progress":
        """A search that goes on from these coordinates with more of them held."""
        let_go = self.cost if self.let_go is None else min(self.let_go, self.cost)
        held = tuple(sorted({*self.held, *numbers}))
        return dataclasses.replace(self.elsewhere(coordinates), held=held, let_go=let_go, began=self.began)

    def elsewhere(self, coordinates: Iterable[float]) -> "Progress":
        """A search that goes on from these coordinates."""
        again = dataclasses.replace(self, step_size=1.0, converged=False, stalled=False, stuck=False, given_up=False)
        return dataclasses.replace(again, coordinates=tuple(coordinates), began=())

    def begun_again(self, longest: float) -> "Progress":
        """A search that begins again where this one did, by moves of another length."""
        return dataclasses.replace(self.elsewhere(self.began), longest=longest, held=(), let_go=None)

    def freed(self) -> "Progress":
        """A search that goes on with nothing held."""
        return dataclasses.replace(self.elsewhere(self.coordinates), held=(), let_go=None, began=self.began)

    def reading_duty(self, coordinates: Iterable[float], linear: Iterable[float]) -> "Progress":
        """A search that goes on with the duty of some traces read as linear between samples."""
        return dataclasses.replace(
            self.elsewhere(coordinates), linear=tuple(linear), corrections=0, found=(), linearised=(), around=()
        )

    def refined(self) -> "Progress":
        """A search that goes on from here by shorter steps along slow traces."""
        return dataclasses.replace(
            self.reading_duty(self.coordinates, self.linear), wanted=(), settled=False, finer=True
        )

    def moving_edges(
        self, coordinates: Iterable[float], late: bool, edges: tuple[tuple[float, ...], ...]
    ) -> "Progress":
        """A search that goes on with edges of the duty that are so late, whose times are free."""
        here = tuple(coordinates)
        again = dataclasses.replace(self.elsewhere(here), corrections=0, found=(), wanted=(), linearised=(), around=())
        return dataclasses.replace(again, late=late, edges=edges, edges_seen=here)

    def seeing_edges(self, edges: tuple[tuple[float, ...], ...]) -> "Progress":
        """A search among its corrections with edges elsewhere, whose derivatives are from here on."""
        return dataclasses.replace(self.linearised_around(()), edges=edges, edges_seen=self.coordinates)

    @property
    def cost(self) -> float:
        """Cost at the accepted coordinates."""
        return self.history[-1]

    @property
    def searched(self) -> float:
        """Cost where the search is or was before it was corrected."""
        return self.history[-1 - self.corrections]

    @property
    def finished(self) -> bool:
        """Whether another step would be wasted."""
        return self.converged or self.stuck or self.given_up or self.iteration >= MAX_ITERATIONS

    @property
    def verdict(self) -> str:
        """Why the fit stopped, or that it has not."""
        if self.corrections and not self.settled:
            return f"not settled after {self.corrections} corrections for sensors and numerical errors"
        if self.corrections:
            return f"{self.corrections} corrections for sensors and numerical errors have settled"
        if self.converged and self.stalled:
            return f"all trials of the last step lowered chi^2 by less than {STALL_TOLERANCE:g}"
        if self.converged:
            return "the last step lowered chi^2 by next to nothing, or another one would"
        if self.given_up:
            return "given up, far from what another structure reaches"
        if self.stuck:
            return "stuck, no trial of the last step lowered the cost"
        if self.iteration >= MAX_ITERATIONS:
            return f"not converged after {MAX_ITERATIONS} iterations"
        return "running"


Report = Callable[[Progress], None]
"""Is told where a fit stands after every step."""


def quiet(progress: Progress) -> None:
    """Says nothing of a step."""
