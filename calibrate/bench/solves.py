"""How the solves of a controller that optimises at every sample ended."""

import collections
import dataclasses
from collections.abc import Mapping
from typing import Any


@dataclasses.dataclass
class Solves:
    """Endings of solves, as CasADi names them, and how often each was; `converged` counts those that were a success."""

    endings: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    converged: int = 0

    def note(self, stats: Mapping[str, Any]) -> None:
        """One more, by the statistics that its solver has afterwards."""
        self.endings[stats["return_status"]] += 1
        self.converged += bool(stats["success"])

    def take(self) -> str:
        """How many did not converge, of how many; counting begins anew."""
        total, failed = self.endings.total(), self.endings.total() - self.converged
        self.endings.clear()
        self.converged = 0
        return f"{failed:,} of {total:,} solves did not converge"
