"""Fits of different structures to the same traces, ranked, and whether the traces can tell which is right."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..._printing import Cells, Printed
from ...estimation import (
    BLOCKS,
    VERDICTS,
    Calibration,
    Comparison,
    Computation,
    Linearised,
    Remains,
    SensorsOfTraces,
    Weighed,
    find_remains,
)

Blocks = Float[np.ndarray, " blocks"]

STRONG = 20.0
"""Difference of the criterion that decides: twice what is very strong evidence (Kass and Raftery, 1995), as what is
compared are the ends of two searches and not two maxima."""
NEEDED = dict(zip(VERDICTS, ((STRONG, 0.0), (1.5 * STRONG, 2.0), (5 * STRONG, 3.0)), strict=True))
"""By what remains of the best: the difference that decides, and by how many standard errors of the scatter between
blocks of time the traces must favour it (Vuong, 1989). Where even the best leaves structure all are wrong, and what
speaks for one must do so everywhere; where it leaves noise, one spot may say all that there is to say."""
SMALL = 1.0
"""Chi^2 that a further linear step promises and that is not worth a search."""
CONTRARY = 1.0
"""Standard errors by which traces that were not fitted may favour another."""
WIDER = "it contains the best one as a limit, so nothing could speak against it"
FEWEST = 3
"""Traces from which on each can be left out."""


@dataclasses.dataclass(frozen=True, eq=False)
class RankedStructure:
    """One structure in a ranking; `reason` says why it can't win, empty if it can.

    `criterion` is Schwarz's, `chi2` in the weights of the best one's sensors, `parameters` those that the traces
    determine, `score` chi^2 per measurement of traces not fitted, in units of the noise; `None` where there is none.
    """

    name: str
    reason: str = ""
    chi2: float | None = None
    parameters: int | None = None
    criterion: float | None = None
    score: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Duel:
    """The best structure against another: by how much its criterion is lower, by how many standard errors the traces
    favour it, those fitted and those not fitted, and why that does not decide (empty if it does)."""

    difference: float
    steadiness: float
    unseen: float | None
    doubt: str = ""

    @property
    def open(self) -> bool:
        """Whether this does not decide, though something could have spoken against the other."""
        return self.doubt not in ("", WIDER)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class StructureRanking(Printed):
    """Structures, best first; `best` is `None` where no fit may be used, `against` has a duel for every other."""

    rows: Sequence[RankedStructure]
    best: str | None
    against: Mapping[str, Duel]
    scored: str
    remains: Sequence[Remains] = ()

    @property
    def rivals(self) -> list[str]:
        """The others that might have won, as their fits may be used."""
        return [row.name for row in self.rows if not row.reason and row.name != self.best]

    def doubting(self, name: str, doubt: str) -> "StructureRanking":
        """The same ranking with a doubt about the duel with one of the others."""
        duel = dataclasses.replace(self.against[name], doubt=doubt)
        return dataclasses.replace(self, against={**self.against, name: duel})

    def doubt(self, rivals: Sequence[str]) -> str:
        """Why the best does not beat all of these beyond doubt; empty if it does."""
        if self.best is None:
            return "no fit may be used"
        return next((f"{name}: {self.against[name].doubt}" for name in rivals if self.against[name].doubt), "")

    def _title(self) -> str:
        return f"Structures, best first, scored on {self.scored}: {self.best or 'no fit may be used'}"

    def _tables(self) -> list[Cells]:
        head = ("structure", "parameters", "chi^2", "criterion", "worse by", "what speaks against a decision")
        rows: list[tuple[str, ...]] = [head]
        for row in self.rows:
            duel = self.against.get(row.name)
            figures = (row.parameters, row.chi2, row.criterion, None if duel is None else duel.difference)
            numbers = ("" if each is None else f"{each:.6g}" for each in figures)
            rows.append((row.name, *numbers, row.reason or ("" if duel is None else duel.doubt)))
        return [rows]


Outcome = Linearised | str
"""A fit, or why there is none."""
Related = Mapping[str, Sequence[str]]
"""By a variant, others."""
ASTRAY = 1000.0
"""Difference of the criterion that decides where a fit has found a duty that comes early, which none does, or two read
it differently between samples: a search has gone astray, and chi^2 may be off by hundreds. A campaign with a squared
Stribeck curve seemed to decide for a plain one by 15, one with a vane force by distance for one by speed by 369."""

RESTLESS = 100.0
"""Difference of the criterion that decides where corrections of a fit have not settled, or its search ended so that
there are none: its chi^2 is off by tens. Two campaigns decided for the wrong exponent of the Stribeck curve by 10 and
19 so."""


APART = 500.0
"""Difference of the criterion that decides between variants whose parameters make up for what tells them apart, as
static force and Stribeck velocity do for the exponent: searches end tens above their best. Of seven campaigns whose
exponent was known five had the wrong one in front, one of them by 180."""


def rank(
    outcomes: Mapping[str, Outcome], wider: Related | None = None, alike: Related | None = None
) -> Computation[StructureRanking]:
    """Ranks fits of the same traces, as a computation.

    **Arguments:** `wider`: which structures contain which others as a limit. Nothing can speak against those. `alike`:
    which have parameters that make up for what tells them from which others.
    """
    fits = {name: each for name, each in outcomes.items() if isinstance(each, Linearised)}
    reasons = {name: unusable(each) for name, each in outcomes.items()}
    able = [name for name in fits if not reasons[name]]
    if not able:
        return StructureRanking([RankedStructure(name, reason) for name, reason in reasons.items()], None, {}, "none")
    # Residuals of all are compared in the weights of one; the one whose own noise explains the traces best.
    likeliest = min(able, key=lambda name: own_criterion(fits[name]))
    common = fits[likeliest].calibration.sensors
    for name, fit in fits.items():
        fits[name] = fit if name == likeliest else (yield from _at_best(fit, common))
    weighed = {name: fit.weighed(common) for name, fit in fits.items()}
    leader = weighed[likeliest]
    scale = max(1.0, leader.chi2 / max(leader.count - leader.rank, 1))
    penalty = float(np.log(leader.count))
    criteria = {name: each.misfit(scale) + each.rank * penalty for name, each in weighed.items()}
    best = min(able, key=criteria.__getitem__)
    unseen = _score(fits, weighed)
    remains = find_remains(fits[best].calibration)
    needed = NEEDED[worst_verdict(remains)]
    rows = [_row(name, reasons[name], weighed, criteria, unseen) for name in outcomes]
    rows.sort(key=lambda row: (row.name != best, bool(row.reason), np.inf if row.criterion is None else row.criterion))
    elsewhere = dict[str, Blocks]() if unseen is None else unseen.blocks
    rivals = {name: _Contender(fits[name], weighed[name], criteria[name], elsewhere.get(name)) for name in fits}
    against = {}
    for name in outcomes:
        if name not in fits:
            against[name] = Duel(0.0, 0.0, None, f"there is no fit of it ({reasons[name]})")
        elif name != best:
            duel = _duel(rivals[best], rivals[name], scale, needed, agreed=name != likeliest)
            if best in (wider or {}).get(name, ()):
                duel = dataclasses.replace(duel, doubt=WIDER)
            elif best in (alike or {}).get(name, ()):
                duel = dataclasses.replace(duel, doubt=duel.doubt or _made_up_for(duel.difference))
            against[name] = duel
    return StructureRanking(rows, best, against, "none" if unseen is None else unseen.what, remains)


@dataclasses.dataclass(frozen=True, eq=False)
class _Contender:
    """A fit in the weights that all are compared in, its criterion, and chi^2 by block of traces not fitted."""

    fit: Linearised
    weighed: Weighed
    criterion: float
    unseen: Blocks | None


def _duel(best: _Contender, other: _Contender, scale: float, needed: tuple[float, float], *, agreed: bool) -> Duel:
    """The best fit against another one; `agreed` is whether the noise of that one would choose the same."""
    # Where a full linear step promises a rival more, it is given that: it may not be at its end in these weights.
    promised = other.weighed.uncertainty.gain / scale
    by_fit = other.weighed.misfit(scale) - best.weighed.misfit(scale) - promised
    difference = other.criterion - promised - best.criterion
    steadiness = _favour(other.weighed.by_block - best.weighed.by_block, promised * scale)
    elsewhere = None
    if other.unseen is not None and best.unseen is not None:
        elsewhere = _favour(other.unseen - best.unseen)
    duellists = (best.fit, other.fit)
    doubt = (
        _doubt((difference, by_fit, steadiness), elsewhere, needed, agreed=agreed)
        or _restless(difference, duellists)
        or _astray(difference, duellists)
        or _read_otherwise(difference, duellists)
    )
    return Duel(difference, steadiness, elsewhere, doubt)


def _doubt(
    found: tuple[float, float, float], unseen: float | None, needed: tuple[float, float], *, agreed: bool
) -> str:
    """Why a duel does not decide, by its difference, the part of it that is no penalty, and its steadiness."""
    difference, by_fit, steadiness = found
    if not agreed:
        return "which one is better changes with which of them tells the noise of the sensors"
    if difference <= needed[0]:
        return f"the criterion differs by {difference:.3g}, {needed[0]:g} would decide"
    if by_fit <= needed[0]:
        return f"only its number of parameters speaks for the best; chi^2 differs by {by_fit:.3g}"
    if steadiness < needed[1]:
        return (
            f"the traces favour the best by {steadiness:.2g} standard errors of the scatter in time, {needed[1]:g} "
            "would decide"
        )
    if unseen is not None and unseen < -CONTRARY:
        return f"traces not fitted favour the other by {-unseen:.2g} standard errors"
    return ""


def _restless(difference: float, duellists: Sequence[Linearised]) -> str:
    """Why a duel does not decide where the corrections of a fit have not settled, or it came to none."""
    if difference > RESTLESS or not any(_uncorrected(each.calibration) for each in duellists):
        return ""
    return (
        "corrections of a fit have not settled, or it came to none, so that its chi^2 is off by tens; the criterion "
        f"differs by {difference:.3g}, {RESTLESS:g} would decide"
    )


def _uncorrected(calibration: Calibration) -> bool:
    """Whether numerical errors, outliers or filtered noise are in a fit's chi^2 that it was to be corrected for."""
    progress = calibration.progress
    return not progress.settled if progress.corrections else calibration.task.unknown.anything


def _astray(difference: float, duellists: Sequence[Linearised]) -> str:
    """Why a duel does not decide where a fit has found a duty that comes early."""
    early = min(each.calibration.duty_delay for each in duellists)
    if early >= 0 or difference > ASTRAY:
        return ""
    return (
        f"the duty of a fit would come {-1e3 * early:.2g} ms early, which none does: its search has gone astray; the "
        f"criterion differs by {difference:.3g}, {ASTRAY:g} would decide"
    )


def _read_otherwise(difference: float, duellists: Sequence[Linearised]) -> str:
    """Why a duel does not decide where its fits read the duty differently."""
    readings = {(each.progress.linear, bool(each.progress.edges)) for each in (fit.calibration for fit in duellists)}
    if len(readings) == 1 or difference > ASTRAY:
        return ""
    return (
        "the two read the duty differently between samples, which alone is worth hundreds; the criterion differs by "
        f"{difference:.3g}, {ASTRAY:g} would decide"
    )


def _made_up_for(difference: float) -> str:
    """Why a duel does not decide between variants that are alike."""
    if difference > APART:
        return ""
    return (
        f"other parameters make up for what tells the two apart; the criterion differs by {difference:.3g}, {APART:g} "
        "would decide"
    )


def worst_verdict(remains: Sequence[Remains]) -> str:
    """The one that says most of structure in what remains."""
    return max((each.verdict for each in remains), key=VERDICTS.index, default=VERDICTS[0])


def _at_best(fit: Linearised, sensors: SensorsOfTraces) -> Computation[Linearised]:
    """A fit where it is best in the weights of another one's sensors."""
    if fit.evaluated.failed or fit.calibration.progress.given_up or fit.weighed(sensors).uncertainty.gain < SMALL:
        return fit
    return (yield from fit.searched(sensors))


def unusable(outcome: Outcome) -> str:
    """Why a fit can't win."""
    if isinstance(outcome, str):
        return outcome
    if outcome.evaluated.failed:
        return f"its simulation failed: {outcome.evaluated.failure.removesuffix('.')}"
    return "" if outcome.calibration.converged else outcome.calibration.verdict


def own_criterion(fit: Linearised) -> float:
    """Schwarz's criterion with the noise that a fit itself has found."""
    own = fit.weighed(fit.calibration.sensors)
    levels = sum(sensor.cost for sensors in fit.calibration.sensors for sensor in sensors.values())
    return own.misfit() + levels + own.rank * float(np.log(own.count))


@dataclasses.dataclass(frozen=True, eq=False)
class _Unseen:
    """Chi^2 by block of traces that were not fitted, by structure; which they are, and how many measurements."""

    what: str
    blocks: Mapping[str, Blocks]
    count: int


def _score(fits: Mapping[str, Linearised], weighed: Mapping[str, Weighed]) -> _Unseen | None:
    some = next(iter(fits.values())).calibration
    if some.task.validate:
        results = [result for result in some.traces if result.use == "validate"]
        count = sum(len(channel.time) for result in results for channel in result.channels.values())
        return _Unseen("validation traces", {name: _validated(fit.calibration) for name, fit in fits.items()}, count)
    if len(some.task.fit) < FEWEST:
        return None
    blocks = {name: each.left_out for name, each in weighed.items()}
    return _Unseen("each trace left out", blocks, next(iter(weighed.values())).count)


def _validated(calibration: Calibration) -> Blocks:
    """Chi^2 by block of the traces to validate, in units of the noise that their signals show."""
    results = [result for result in calibration.traces if result.use == "validate"]
    return np.concatenate([_by_block(channel) for result in results for channel in result.channels.values()])


def _by_block(channel: Comparison) -> Blocks:
    count = len(channel.time)
    return np.bincount(BLOCKS * np.arange(count) // count, (channel.residual / channel.noise) ** 2, BLOCKS)


def _favour(differences: Blocks, less: float = 0.0) -> float:
    """Sum of differences, less a number, in standard errors by their scatter."""
    scatter = float(np.std(differences)) * np.sqrt(len(differences))
    return (float(np.sum(differences)) - less) / max(scatter, 1e-300)


def _row(
    name: str,
    reason: str,
    weighed: Mapping[str, Weighed],
    criteria: Mapping[str, float],
    unseen: _Unseen | None,
) -> RankedStructure:
    if name not in weighed:
        return RankedStructure(name, reason)
    each = weighed[name]
    score = None if unseen is None else float(np.sum(unseen.blocks[name])) / unseen.count
    return RankedStructure(name, reason, each.chi2, each.rank, criteria[name], score)
