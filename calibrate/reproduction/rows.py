"""A row of the reproduction table: what is printed, what we get, and the rule that turns both into a verdict."""

import dataclasses
import enum
from collections.abc import Callable, Mapping

import numpy as np

Value = float | tuple[float, ...]


class Kind(enum.Enum):
    """What a row compares with the print, and so what it shows when its rule is met. Only a `RESULT` is reproduced."""

    RESULT = enum.auto()
    """What our model makes of the thesis's own inputs, with what the thesis says that comes out."""
    INPUT = enum.auto()
    """What our model gives back of a printed value that it was given."""
    IDENTITY = enum.auto()
    """What definitions, algebra or another line of the print say, whatever the actuator does."""
    RECOVERY = enum.auto()
    """What comes back of a printed value that our own simulation was given."""
    OWN_INPUTS = enum.auto()
    """What comes of inputs that we chose and the thesis does not print: gains, references, sensors, plants, ranges."""


class Verdict(enum.StrEnum):
    """What a row says of the print. [`MEANING`][] explains every one of them."""

    REPRODUCED = "reproduced"
    OWN_MET = "met with our inputs"
    RECOVERED = "recovered"
    INPUT = "input"
    IDENTITY = "identity"
    DIFFERS = "differs"
    OWN_MISSED = "missed with our inputs"
    NOT_RECOVERED = "not recovered"
    NOT_REPRODUCIBLE = "not reproducible"


MEANING: Mapping[Verdict, str] = {
    Verdict.REPRODUCED: "a result of the thesis, met by our model from the thesis's own inputs",
    Verdict.OWN_MET: "a figure of the thesis, met with inputs of ours that it does not print, as gains, references, "
    "sensors and exhaust gas forces: what our choice can do",
    Verdict.RECOVERED: "a printed value that our own simulation was given, found again in its signals: a test of our "
    "identification, not of the value",
    Verdict.INPUT: "a printed value that our model was given, read back: a test of the reading",
    Verdict.IDENTITY: "holds by definition, by algebra or by another line of the print, whatever the actuator does",
    Verdict.DIFFERS: "does not follow from the thesis's own inputs, equations or other lines; mistakes of the print "
    "are among them",
    Verdict.OWN_MISSED: "a figure of the thesis, not met with inputs of ours that it does not print",
    Verdict.NOT_RECOVERED: "a printed value that our own simulation was given, not found again in its signals",
    Verdict.NOT_REPRODUCIBLE: "the thesis does not print what a check would need; our value is the nearest that can be "
    "said",
}
"""Every verdict in the words of a reader, in the order in which they are counted."""

JUDGED: Mapping[Kind, tuple[Verdict, Verdict]] = {
    Kind.RESULT: (Verdict.REPRODUCED, Verdict.DIFFERS),
    Kind.INPUT: (Verdict.INPUT, Verdict.DIFFERS),
    Kind.IDENTITY: (Verdict.IDENTITY, Verdict.DIFFERS),
    Kind.RECOVERY: (Verdict.RECOVERED, Verdict.NOT_RECOVERED),
    Kind.OWN_INPUTS: (Verdict.OWN_MET, Verdict.OWN_MISSED),
}
"""The verdict on a row of each kind whose rule is met, and on one whose rule is not."""


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

    `kind` says what is compared with it. `section` is the number and title that it stands under, `where` the equation,
    table or figure, `printed` the words or digits with their unit. `ours` computes, in `unit`. `reason` may name
    `{ours}`, whether it `{meets}` the rule, and the facts that `ours` found. `missing` names what a check would need
    and the thesis does not print; then no number decides, what `ours` computes is the nearest that can be said, and
    `rule` may be `None`.
    `slow` rows fit or identify something, which takes ten seconds once.
    """

    id: str
    kind: Kind
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
            return Verdict.NOT_REPRODUCIBLE
        met, missed = JUDGED[self.kind]
        return met if self.rule.met(ours) else missed


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
            "kind": row.kind.name.lower().replace("_", " "),
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
