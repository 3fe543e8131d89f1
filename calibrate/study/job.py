"""What every command has of its study."""

import dataclasses
from typing import Any

from .tables import Study


@dataclasses.dataclass(frozen=True, eq=False)
class StudyJob:
    """A study that was read and checked: nothing has been written yet.

    `text` is the file word by word, `fingerprint` a digest of all that a result depends on.
    """

    study: Study
    text: str
    fingerprint: str

    def heading(self, unit: str | None = None) -> dict[str, Any]:
        """What every report says of its study."""
        return {
            "title": self.study.name if unit is None else f"{self.study.name}: {unit}",
            "study": self.study,
            "study_text": self.text,
            "fingerprint": self.fingerprint,
        }

    def account(self, seconds: float) -> dict[str, Any]:
        """What every summary says of its study."""
        return {"wall_seconds": round(seconds, 3), "study_sha256": self.fingerprint}
