"""What a fit of one unit has come to."""

import dataclasses
from typing import Any

from vgtjax import Calibration
from vgtjax.assurance import Certificate, Posterior
from vgtjax.estimation import Around


@dataclasses.dataclass(frozen=True, eq=False)
class Fitted:
    """A fit that came to its end, the seconds it took, and what its traces could tell at the start.

    The misfit around its end is looked at where that is one and its derivatives are right, and its posterior where that
    is asked for as well.
    """

    calibration: Calibration
    certificate: Certificate
    around: Around | None
    posterior: Posterior | None
    seconds: float
    known_before: dict[str, Any]

    @property
    def troubles(self) -> list[str]:
        """A sentence on each thing that is wrong."""
        wrong = [] if self.certificate.passed else [self.certificate.sentence]
        return [*wrong, *self.calibration.troubles]

    @property
    def not_estimable(self) -> list[str]:
        """Free entries that belonged to null directions at the start, so that the traces did not determine them."""
        return list(self.known_before["undetermined"])
