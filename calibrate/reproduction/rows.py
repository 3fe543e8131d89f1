"""A row of the reproduction table: what is printed, what we get, and the rule that turns both into a verdict."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

Value = float | tuple[float, ...]
Verdict = Literal["reproduced", "differs", "not reproducible"]


@dataclasses.dataclass(frozen=True)
class Near:
    """Holds within a tolerance of the printed value, usually half of its last digit."""

    value: float
    tolerance: float

    def met(self, ours: Value) -> bool:
        """Whether every value is close to the printed one."""
        return bool(np.all(np.abs(np.asarray(ours) - self.value) <= self.tolerance))

    def __str__(self) -> str:
        return f"{self.value:g} ± {self.tolerance:g}"


@dataclasses.dataclass(frozen=True)
class Between:
    """Holds between two ends, both included."""

    low: float
    high: float

    def met(self, ours: Value) -> bool:
        """Whether every value lies between the ends."""
        values = np.asarray(ours)
        return bool(np.all((self.low <= values) & (values <= self.high)))

    def __str__(self) -> str:
        if self.high == np.inf:
            return f"at least {self.low:g}"
        return f"{self.low:g} to {self.high:g}"


@dataclasses.dataclass(frozen=True)
class Rising:
    """Holds when each value exceeds the one before it by more than a margin."""

    margin: float = 0.0

    def met(self, ours: Value) -> bool:
        """Whether the values rise."""
        return bool(np.all(np.diff(np.asarray(ours)) > self.margin))

    def __str__(self) -> str:
        return "rising" + (f", each by over {self.margin:g}" if self.margin else "")


Rule = Near | Between | Rising


@dataclasses.dataclass(frozen=True)
class Found:
    """What we get, in the unit of the print, and further numbers that the reason names."""

    value: Value
    facts: Mapping[str, float | str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Row:
    """One statement of the thesis.

    `section` is the number and title that it stands under, `where` the equation, table or figure, `printed` the words
    or digits with their unit. `ours` computes, in `unit`. `reason` may name `{ours}`, whether it `{meets}` the rule,
    and the facts that `ours` found. `missing` names what a check would need and the thesis does not print; then no
    number decides, what `ours` computes is the nearest that can be said, and `rule` may be `None`.
    `slow` rows fit or identify something, which takes ten seconds once.
    """

    id: str
    section: str
    quantity: str
    where: str
    printed: str
    unit: str
    rule: Rule | None
    ours: Callable[[], Found | float]
    reason: str
    missing: str = ""
    slow: bool = False

    def __post_init__(self) -> None:
        if self.rule is None and not self.missing:
            raise ValueError(f"{self.id}: a row needs a rule, or must say what the print is missing; give one of them")

    def evaluate(self) -> "Result":
        """Computes our value and judges it."""
        found = self.ours()
        found = found if isinstance(found, Found) else Found(float(found))
        text = shown(found.value)
        meets = "meets" if self.rule is not None and self.rule.met(found.value) else "does not meet"
        reason = self.reason.format(ours=text, meets=meets, **found.facts)
        if self.missing:
            reason = f"The thesis does not print {self.missing}. {reason}"
        return Result(self, found.value, self.judge(found.value), reason)

    def judge(self, ours: Value) -> Verdict:
        """The verdict on a value: by the rule, unless the print lacks what the rule needs."""
        if self.missing or self.rule is None:
            return "not reproducible"
        return "reproduced" if self.rule.met(ours) else "differs"


@dataclasses.dataclass(frozen=True)
class Result:
    """A row with our value and the verdict."""

    row: Row
    ours: Value
    verdict: Verdict
    reason: str

    @property
    def text(self) -> str:
        """Our value as a reader wants it, with its unit."""
        return f"{shown(self.ours)} {self.row.unit}".strip()

    def to_json(self) -> dict[str, object]:
        """The row for `reproduction.json`."""
        row = self.row
        return {
            "id": row.id,
            "section": row.section,
            "quantity": row.quantity,
            "where": row.where,
            "printed": row.printed,
            "unit": row.unit,
            "rule": "" if row.rule is None else str(row.rule),
            "ours": list(self.ours) if isinstance(self.ours, tuple) else self.ours,
            "verdict": self.verdict,
            "reason": self.reason,
        }


def shown(value: Value) -> str:
    """A value or several as a reader wants them: four digits, and as zero what no unit of the table tells from it."""
    values = value if isinstance(value, tuple) else (value,)
    return ", ".join(
        f"{entry:.0f}" if abs(entry) >= 1000 else f"{entry:.4g}" if abs(entry) > 1e-5 else "0" for entry in values
    )
