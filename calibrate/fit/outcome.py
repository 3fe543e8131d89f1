"""What a fit of one unit has come to."""

import dataclasses
from typing import Any

from vgtjax.assurance import CertifiedFit, Posterior


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fitted(CertifiedFit):
    """A fit that came to its end, the seconds it took, and what its traces could tell at the start.

    Its posterior is there where the fit is usable and that is asked for.
    """

    posterior: Posterior | None
    seconds: float
    known_before: dict[str, Any]

    @property
    def not_estimable(self) -> list[str]:
        """Free entries that belonged to null directions at the start, so that the traces did not determine them."""
        return list(self.known_before["undetermined"])
