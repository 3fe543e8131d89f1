"""What a comparison of structures says of every component, as `summary.json` states it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from vgtjax.estimation import VERDICTS, Calibration, Remains, find_remains, sample_interval
from vgtjax.identification import Compared, RankedStructure, StructureRanking, worst_verdict

from ..study.tables import Study
from ..study.units import Unit
from .alternatives import EXPONENTS, STILL, options, own_structure

UNSETTLED = "every sweep through the components changed another one"
ALONE = "there is nothing to compare it with"
GREEDY = (
    "one component was changed at a time, the others as in the structure found so far, and what one has beaten once "
    "more beside what another can't tell; what else is better only together is not found"
)


@dataclasses.dataclass(frozen=True)
class Choice:
    """What is chosen for one component, and why that is decided or not."""

    value: str | int | float | None
    decided: bool
    reason: str


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What is chosen for every component, the table of all structures, and what remains of the best."""

    choices: Mapping[str, Choice]
    table: list[dict[str, Any]]
    remains: list[Remains]
    scored: str

    def summary(self) -> dict[str, Any]:
        """As `summary.json` has it."""
        return {
            "chosen": {name: choice.value for name, choice in self.choices.items()},
            "decided": {name: choice.decided for name, choice in self.choices.items()},
            "reasons": {name: choice.reason for name, choice in self.choices.items()},
            "search": GREEDY,
            "scored_on": self.scored,
            "table": self.table,
            "remains": [dataclasses.asdict(each) for each in self.remains],
        }


def judge(study: Study, unit: Unit, compared: Compared) -> Verdict:
    """What was found for one unit."""
    choices: dict[str, Choice] = {}
    for component, value in own_structure(study).items():
        if component not in options(study, unit):
            choices[component] = Choice(value, False, STILL)
        elif component == "friction":
            choices |= _friction(compared.rankings[component], compared.structure[component])
        else:
            choices[component] = _beyond(compared.rankings[component], compared.structure[component])
    if not compared.settled:
        choices = {name: Choice(choice.value, False, UNSETTLED) for name, choice in choices.items()}
    rankings = list(compared.rankings.values())
    remains = [] if compared.fit is None else find_remains(compared.fit.calibration)
    choices |= _duty(unit, compared, far=worst_verdict(remains) == VERDICTS[-1])
    return Verdict(choices, _table(compared), remains, rankings[0].scored)


def _beyond(ranking: StructureRanking, chosen: str, kin: Sequence[str] = ()) -> Choice:
    """What is chosen of a ranking, decided if it is the best, beyond doubt against all that are not of its kin."""
    rivals = [name for name in ranking.against if name not in kin]
    doubt = ranking.doubt(rivals) if rivals else ALONE
    if ranking.best not in (chosen, *kin):
        doubt = doubt or "it is not clearly better than the study's own"
    if doubt and doubt != ALONE and ranking.best != chosen:
        doubt = f"'{ranking.best}' is better, but not clearly ({doubt})"
    return Choice(chosen, not doubt, doubt or "better than every other beyond doubt")


def _friction(ranking: StructureRanking, chosen: str) -> dict[str, Choice]:
    """The family, and the exponent of its Stribeck curve, which are one list of variants."""
    kin = tuple(EXPONENTS) if chosen in EXPONENTS and ranking.best in EXPONENTS else ()
    family = _beyond(ranking, chosen, kin)
    name = "lugre" if chosen == "lugre-squared" else chosen
    if chosen not in EXPONENTS:
        exponent = Choice(None, False, f"'{chosen}' has no Stribeck curve with an exponent")
    else:
        alone = _beyond(ranking, chosen, [name for name in ranking.against if name not in EXPONENTS])
        exponent = dataclasses.replace(alone, value=EXPONENTS[chosen])
    return {"friction": dataclasses.replace(family, value=name), "stribeck_exponent": exponent}


def _duty(unit: Unit, compared: Compared, *, far: bool) -> dict[str, Choice]:
    """How the duty was held and how late it is; nothing for a model without a duty."""
    if "pwm" not in unit.model.needs or compared.fit is None:
        return {}
    calibration = compared.fit.calibration
    intervals = {trace.name: sample_interval(trace) for trace in calibration.task.fit}
    slowest, fastest = max(intervals.values()), min(intervals.values())
    slow = [trace for trace in calibration.task.fit if intervals[trace.name] == slowest]
    holds = {calibration.duty_hold(trace) for trace in slow}
    stated = set(unit.stated.get("duty_hold", ()))
    hold = next(iter(stated)) if len(stated) == 1 else "linear" if holds == {"linear"} else "zero-order"
    known = next(iter(unit.stated.get("duty_delay", ())), None)
    delay = calibration.duty_delay if known is None else known
    decided, reason = _told(calibration, known, bool(stated), hold)
    if decided and fastest < slowest:
        reason += (
            f"; that is said of the slowest traces, {1e3 * slowest:g} ms per sample: how the duty of others was held "
            f"may be open, and the delay with it by half a sample of theirs, {500 * fastest:g} ms of the fastest"
        )
    if decided and far:
        decided, reason = False, f"{reason}; but even the best structure leaves evident structure"
    return {"duty_hold": Choice(hold, decided, reason), "duty_delay": Choice(delay, decided, reason)}


def _told(calibration: Calibration, known: float | None, stated: bool, hold: str) -> tuple[bool, str]:
    """Whether a fit tells how the duty was held and how late it is, and why."""
    if known is not None:
        return False, "the study states the delay, so none was looked for"
    if stated:
        return False, "the study states the hold, so another was not looked for"
    if calibration.progress.hold_decided is None:
        return False, "the study says that none is to be looked for"
    if not calibration.progress.hold_decided:
        return False, "a held duty and a linear one that is later by half a sample are the same, or neither fits"
    if hold == "linear":
        return True, "a duty that is held would arrive before it is given"
    return True, "held and not late is the simplest explanation"


def _table(compared: Compared) -> list[dict[str, Any]]:
    """A row for every structure of every component, the best of each first."""
    return [_row(component, ranking, row) for component, ranking in compared.rankings.items() for row in ranking.rows]


def _row(component: str, ranking: StructureRanking, row: RankedStructure) -> dict[str, Any]:
    duel = ranking.against.get(row.name)
    return {
        "component": component,
        **dataclasses.asdict(row),
        "difference": None if duel is None or row.criterion is None else duel.difference,
        "steadiness": None if duel is None or row.criterion is None else duel.steadiness,
        "unseen": None if duel is None else duel.unseen,
        "doubt": "" if duel is None else duel.doubt,
    }
