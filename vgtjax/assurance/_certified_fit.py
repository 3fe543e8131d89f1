"""A fit as it may be signed: its values, what its derivatives are worth, and how the misfit looks around its end."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Literal

from .._printing import Cells, Printed
from ..estimation import (
    Around,
    Calibration,
    Calibrator,
    Computation,
    Estimate,
    Progress,
    estimate_table,
    foreseen,
    foreseen_certificate,
    looking_around,
    run_alone,
)
from ..identification import plan_fit, starting_fit
from ..plants import AbstractModel
from ..traces import Trace
from ._certificate import Certificate, certified

Profiled = Literal["flagged", "all", "none"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class CertifiedFit(Printed):
    """A calibration at its end, the certificate of its derivatives, and the misfit around it, which is looked at where
    values and derivatives are right. It prints itself as the calibration does, and what else there is to say."""

    calibration: Calibration
    certificate: Certificate
    around: Around | None

    @property
    def usable(self) -> bool:
        """Whether values and errors may be used: the search has converged, and derivatives are what differences
        show."""
        return self.calibration.converged and self.certificate.passed

    @property
    def troubles(self) -> list[str]:
        """A sentence on each thing that is wrong."""
        wrong = [] if self.certificate.passed else [self.certificate.sentence]
        return [*wrong, *self.calibration.troubles]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """What was found of every free entry by its name, with the interval of its profile where it has one."""
        return self.calibration.estimates if self.around is None else self.around.estimates(self.calibration)

    def __getitem__(self, entry: str) -> Estimate:
        """What was found of a free entry, as of a [`Calibration`][].

        **Raises:** `InputError` for a name that no free entry has.
        """
        return self.estimates[entry] if entry in self.estimates else self.calibration[entry]

    def _title(self) -> str:
        said = "; ".join(self.troubles) or self.calibration.verdict
        return f"Certified fit: {'usable' if self.usable else 'NOT usable'}; {said}"

    def _tables(self) -> list[Cells]:
        return [estimate_table(self.estimates), self.calibration.comparisons]

    def _sentences(self) -> list[str]:
        around = [] if self.around is None else self.around.sentences
        return [*self.calibration.sentences, self.certificate.sentence, *self.certificate.remarks, *around]


def certified_fit(
    model: AbstractModel,
    traces: Sequence[Trace],
    validate: Sequence[Trace] = (),
    *,
    profiles: Profiled = "flagged",
    report: Callable[[Progress], None] = lambda progress: None,
    **choices: Any,
) -> CertifiedFit:
    """What the command `fit` finds of one unit: [`fit`][], a certificate of the derivatives that its errors rest on, a
    search with finer steps where that fails, and profiles of what is not as errors to first order say. What traces can
    tell beforehand, which the command asks as well, says [`examine`][].

    **Arguments:** `choices` as those of [`fit`][]; `profiles`: of which entries, those that something speaks against,
    all or none; `report`: called with the progress after every step.

    **Raises:** as [`fit`][].
    """
    task = plan_fit(model, traces, validate, **choices)

    def whole() -> Computation[CertifiedFit]:
        calibrator = yield from starting_fit(task)
        return (yield from ending_certified(calibrator, report, profiles))[1]

    return run_alone(whole(), [*foreseen(task), foreseen_certificate(task)])


def ending_certified(
    calibrator: Calibrator, report: Callable[[Progress], None], profiles: Profiled
) -> Computation[tuple[Calibrator, CertifiedFit]]:
    """The rest of a fit that has begun, as a computation, and where its search ended."""
    calibrator, certificate = yield from certified((yield from calibrator.ending(report)), report)
    found = CertifiedFit((yield from calibrator.finishing()), certificate, None)
    if found.usable:
        found = dataclasses.replace(found, around=(yield from looking_around(calibrator, profiles)))
    return calibrator, found
