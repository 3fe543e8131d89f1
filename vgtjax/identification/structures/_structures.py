"""Which structure the traces favour: one component changed at a time, each alternative fitted."""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from ..._errors import SimulationError
from ...estimation import (
    RECORDED,
    VERDICTS,
    Calibration,
    Computation,
    Linearised,
    Reading,
    Task,
    find_remains,
    run_alone,
)
from ...parameters import get_parameter, parameter_table
from ._ranking import Outcome, Related, StructureRanking, own_criterion, rank, unusable

MOST_SWEEPS = 3
"""Times that all components are gone through; after that nothing is decided."""

Structure = Mapping[str, str]
"""The variant of every component."""
Values = Mapping[str, Any]
"""Values of parameters by name, to start from those that a structure has."""


@dataclasses.dataclass(frozen=True)
class Begin:
    """How the fit of a structure begins: from which `values`, whether it is `again`, the second of that structure, and
    the `ceiling` of its task: the cost that another structure reaches, by a `reading` of the duty."""

    values: Values
    again: bool = False
    ceiling: float = np.inf
    reading: Reading = RECORDED

    def of(self, task: Task) -> Task:
        """The task of a structure that begins like this, but for its values."""
        return dataclasses.replace(task, ceiling=self.ceiling, reading=self.reading)


Fitting = Callable[[Structure, Begin], Computation[Calibration]]
"""The fit of a structure."""
Ahead = Callable[[Sequence[Structure]], AbstractContextManager[None]]
"""What is done beside the fits of some structures, as long as these go on, e.g. compilation."""


def nothing_ahead(structures: Sequence[Structure]) -> AbstractContextManager[None]:
    """Nothing is done beside the fits of structures."""
    return nullcontext()


@dataclasses.dataclass(frozen=True, eq=False)
class Compared:
    """A ranking for every component, the best structure (`None` where no fit may be used), and its fit.

    The others of a component were fitted with the rest of `structure`. `settled` is whether a last sweep changed
    nothing.
    """

    rankings: Mapping[str, StructureRanking]
    structure: Structure
    fit: Linearised | None
    settled: bool


def compare_structures(
    own: Structure,
    options: Mapping[str, Sequence[str]],
    fitting: Fitting,
    wider: Related | None = None,
    alike: Related | None = None,
) -> Compared:
    """Fits the alternatives of each component and ranks them.

    The search is greedy: one component is changed at a time, beginning at `own`, and what is clearly better stays.
    Where one component is decided and another is not, what is beaten of the first is tried beside what is not beaten
    of the other. Otherwise a structure that is better only with two components changed together is not found.

    **Arguments:** `options`: of each component, among them that of `own`; `fitting`: makes a computation that fits a
    structure, e.g. with [`starting_fit`][]; `wider`: which variants contain which others as a limit; `alike`: which
    have parameters that make up for what tells them from which others, so that only what is far apart decides.
    """
    return run_alone(comparing_structures(own, options, fitting, wider, alike))


def comparing_structures(
    own: Structure,
    options: Mapping[str, Sequence[str]],
    fitting: Fitting,
    wider: Related | None = None,
    alike: Related | None = None,
    ahead: Ahead = nothing_ahead,
) -> Computation[Compared]:
    """`compare_structures` as a computation.

    **Arguments:** `ahead`: is told which structures are fitted next, and what it returns is left when they are.
    """
    search, base = _Search(fitting, wider, alike, ahead), dict(own)
    rankings: dict[str, StructureRanking] = {}
    ranked_in: dict[str, Structure] = {}
    for _ in range(MOST_SWEEPS):
        before = dict(base)
        for component, names in options.items():
            if ranked_in.get(component) == base:
                continue
            rankings[component] = yield from search.rank(base, component, names)
            base[component] = _better(rankings[component], base[component])
            ranked_in[component] = dict(base)
        if base == before:
            rankings, base = yield from search.together(rankings, base)
        if base == before:
            return Compared(rankings, base, search.usable(base), True)
    return Compared(rankings, base, search.usable(base), False)


def _better(ranking: StructureRanking, now: str) -> str:
    """The variant to go on with: another one only if it is better beyond doubt, or this one's fit may not be used."""
    if ranking.best is None or ranking.best == now:
        return now
    unusable_now = next(row.reason for row in ranking.rows if row.name == now)
    return ranking.best if unusable_now or not ranking.against[now].doubt else now


def _pairs(rankings: Mapping[str, StructureRanking], base: Structure) -> list[tuple[tuple[str, str], tuple[str, str]]]:
    """A component and a variant that is beaten, and another component and one that is not told from that of the base,
    all with fits that may be used. One that contains the best as a limit is left out: it always meets the traces as
    well."""
    beaten = [(name, row) for name, each in rankings.items() for row in each.rivals if not each.against[row].doubt]
    left = [(name, row) for name, each in rankings.items() for row in _undecided(each, base[name])]
    return [(one, other) for one, other in itertools.product(beaten, left) if one[0] != other[0]]


def _undecided(ranking: StructureRanking, now: str) -> list[str]:
    """Variants of a component that may be right instead of the one of a structure."""
    leading = [ranking.best] if ranking.best not in (None, now) else []
    return [*leading, *(name for name in ranking.rivals if name != now and ranking.against[name].open)]


class _Search:
    """The fits so far, by structure."""

    def __init__(self, fitting: Fitting, wider: Related | None, alike: Related | None, ahead: Ahead):
        self._fitting, self._wider, self._alike, self._ahead = fitting, wider, alike, ahead
        self._fits: dict[tuple[str, ...], Outcome] = {}
        self._again: set[tuple[str, ...]] = set()

    def usable(self, structure: Structure) -> Linearised | None:
        """The fit of a structure, if it may be used."""
        found = self._fits.get(_key(structure))
        return found if isinstance(found, Linearised) and not unusable(found) else None

    def rank(self, base: Structure, component: str, names: Sequence[str]) -> Computation[StructureRanking]:
        """The variants of a component in a structure, those fitted that aren't yet."""
        structures = {name: {**base, component: name} for name in names}
        in_turn = (base, *(each for each in structures.values() if each != base))
        with self._ahead([each for each in in_turn if _key(each) not in self._fits]):
            yield from self._fit(base, Begin({}))
            for structure in structures.values():
                yield from self._fit_beside(structure, self._beside(base))
        ranking = yield from self._rank(structures)
        if ranking.best is None or ranking.best == base[component] or _key(base) in self._again:
            return ranking
        # The others began where the base ended; the base may begin at the best one's end as well.
        yield from self._fit(base, Begin(self._values(structures[ranking.best]), again=True))
        return (yield from self._rank(structures))

    def _rank(self, structures: Mapping[str, Structure]) -> Computation[StructureRanking]:
        """The fits of the variants of a component."""
        outcomes = {name: self._fits[_key(structure)] for name, structure in structures.items()}
        return (yield from rank(outcomes, self._wider, self._alike))

    def together(
        self, rankings: Mapping[str, StructureRanking], base: dict[str, str]
    ) -> Computation[tuple[dict[str, StructureRanking], dict[str, str]]]:
        """Rankings in which nothing is beaten that is not so beside each undecided variant of another component, and
        the structure to go on with: one with both changed, where that is better beyond doubt."""
        found = dict(rankings)
        for (component, beaten), (other, variant) in _pairs(rankings, base):
            beside = {**base, other: variant}
            both, now = {**beside, component: beaten}, base[component]
            with self._ahead([both] if _key(both) not in self._fits else []):
                yield from self._fit_beside(both, self._beside(beside))
            if _better((yield from self._duel(base, both, "now", "both")), "now") == "both":
                return found, both
            pair = {now: self._fits[_key(beside)], beaten: self._fits[_key(both)]}
            ranking = yield from rank(pair, alike=self._alike)
            duel = ranking.against[beaten if ranking.best == now else now]
            why = duel.doubt or ("" if ranking.best == now else f"it is better by {duel.difference:.3g}")
            if why:
                found[component] = found[component].doubting(beaten, f"with {variant} as {other}: {why}")
        return found, base

    def _duel(self, base: Structure, both: Structure, now: str, name: str) -> Computation[StructureRanking]:
        """Two structures under these names; if the base does not lead, it has begun at the end of the other as well."""
        ranking = yield from rank({now: self._fits[_key(base)], name: self._fits[_key(both)]})
        if ranking.best != name or _key(base) in self._again:
            return ranking
        yield from self._fit(base, Begin(self._values(both), again=True))
        return (yield from rank({now: self._fits[_key(base)], name: self._fits[_key(both)]}))

    def _fit_beside(self, structure: Structure, begin: Begin) -> Computation[None]:
        """A fit from the values of another structure or, if these can't be simulated, from its own."""
        yield from self._fit(structure, begin)
        if begin.values and isinstance(self._fits[_key(structure)], str):
            del self._fits[_key(structure)]
            yield from self._fit(structure, dataclasses.replace(begin, values={}))

    def _fit(self, structure: Structure, begin: Begin) -> Computation[None]:
        key = _key(structure)
        if key in self._fits and not begin.again:
            return
        try:
            calibration = yield from self._fitting(structure, begin)
            found: Outcome = yield from Linearised.of(calibration)
        except SimulationError as error:
            found = str(error)
        if begin.again:
            self._again.add(key)
            found = _of_two(self._fits[key], found)
        self._fits[key] = found

    def _beside(self, structure: Structure) -> Begin:
        """How others begin beside a structure: from its values, and with the cost to which they must come down. None
        where what reads the duty otherwise than it is recorded leaves more than noise, and may well read it wrongly."""
        found, values = self._fits[_key(structure)], self._values(structure)
        if not isinstance(found, Linearised) or unusable(found):
            return Begin(values)
        calibration, progress = found.calibration, found.calibration.progress
        reading = Reading(progress.linear, progress.edges, calibration.duty_delay)
        if reading != RECORDED and _misses(calibration):
            return Begin(values)
        return Begin(values, ceiling=progress.searched, reading=reading)

    def _values(self, structure: Structure) -> Values:
        """Where another structure begins: at the end of this one's fit, unless that is nowhere near the traces. Its
        values have gone to make up for what it lacks, and the right structure would not find back from there."""
        found = self._fits[_key(structure)]
        if not isinstance(found, Linearised) or _misses(found.calibration):
            return {}
        model = found.calibration.model
        return {name: np.asarray(get_parameter(model, name)).tolist() for name in parameter_table(model)}


def _misses(calibration: Calibration) -> bool:
    """Whether what remains is larger than the noise that the signals show."""
    return any(each.over == "size" and each.verdict == VERDICTS[-1] for each in find_remains(calibration))


def _of_two(first: Outcome, second: Outcome) -> Outcome:
    """The better of two fits of one structure."""
    if isinstance(second, str) or unusable(second):
        return first
    if isinstance(first, str) or unusable(first):
        return second
    return min(first, second, key=own_criterion)


def _key(structure: Structure) -> tuple[str, ...]:
    return tuple(structure.values())
