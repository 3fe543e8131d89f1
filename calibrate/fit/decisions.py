"""What a report decides, each with its limit and the rule by which that decides."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from vgtjax.assurance import REPEATED, UNEQUAL, WRONG, WRONG_ALONE, Certificate, largest
from vgtjax.estimation import MEETS

from ..output.files import finite
from ..study.parameter_file import Entry
from .outcome import Fitted

FURTHER = 1.0
"""chi^2 that a further linear step may promise: one standard error."""
ACCEPTANCE = "the whole 95 % interval lies within: guarded acceptance, 1.96 standard errors inside of the limits"


@dataclasses.dataclass(frozen=True)
class Decision:
    """One decision: what was `found` beside its limits, either `None`, the `rule` in words, and the `verdict`."""

    what: str
    found: float
    lower: float | None
    upper: float | None
    rule: str
    verdict: str

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        return {**dataclasses.asdict(self), "found": finite(self.found)}


def decisions(fitted: Fitted, entries: Sequence[Entry]) -> list[Decision]:
    """All decisions of a fit: on its derivatives, its end, its traces, and every value that has limits."""
    return [*_of_the_fit(fitted), *(_of_a_value(entry) for entry in entries if entry.free and _limited(entry))]


def _of_the_fit(fitted: Fitted) -> Iterator[Decision]:
    calibration, certificate = fitted.calibration, fitted.certificate
    yield from _of_derivatives(certificate)
    rule = "a full linear step from the end may not promise more, or errors are indicative"
    yield _below("chi^2 that a further linear step promises", calibration.uncertainty.gain, FURTHER, rule)
    rule = "what remains of no signal of a fitted trace may be more times its sensor's noise"
    # A trace whose simulation failed is the worst, and has no number.
    failed = {result.trace.name for result in calibration.traces if result.failed}
    ratios = {place: np.inf if place[0] in failed else ratio for place, ratio in calibration.noise_ratios.items()}
    (trace, channel), worst = max(ratios.items(), key=lambda pair: pair[1])
    yield _below(f"worst trace: {channel} of {trace}", np.nan if trace in failed else worst, MEETS, rule)


def _of_derivatives(certificate: Certificate) -> Iterator[Decision]:
    rule = "along no random direction may derivatives differ from {} by a larger part"
    what, worst, limit, by = "derivatives", largest(certificate.mismatches), WRONG, rule.format("differences")
    if worst > WRONG:
        what = "derivatives with respect to one parameter"
        worst, limit = largest(certificate.alone.values()), WRONG_ALONE
        by = (
            f"where random directions miss differences by more than {WRONG:g}, as at a kink, no derivative with "
            "respect to one parameter may by a larger part, asked ever nearer to the end"
        )
    yield _below(f"{what} against differences", worst, limit, by)
    by, limit = rule.format("reverse mode"), certificate.repeated
    if limit > UNEQUAL:
        by += f", {UNEQUAL:g} or {REPEATED} times what places a rounding away differ by"
    yield _below("derivatives against reverse mode", largest(certificate.modes), limit, by)


def _below(what: str, found: float, limit: float, rule: str) -> Decision:
    return Decision(what, found, None, limit, rule, "kept" if found <= limit else "exceeded")


def _limited(entry: Entry) -> bool:
    return entry.lower is not None or entry.upper is not None


def _of_a_value(entry: Entry) -> Decision:
    """Whether a value keeps to the limits that the study sets: only beyond doubt."""
    if entry.at_bound:
        verdict = "at its limit"
    elif entry.interval is None or not entry.identifiable:
        verdict = "not decided: the value is not determined"
    else:
        low, high = entry.interval
        above = entry.lower is None or (low is not None and low >= entry.lower)
        below = entry.upper is None or (high is not None and high <= entry.upper)
        verdict = "within" if above and below else "not decided: the interval reaches beyond"
    return Decision(entry.name, entry.value, entry.lower, entry.upper, ACCEPTANCE, verdict)
