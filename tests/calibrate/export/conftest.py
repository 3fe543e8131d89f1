"""Two fits to export: the small one, with hashes of its traces; a unit of the fleet, with tables on knots."""

import dataclasses
import pathlib
from collections.abc import Callable

import pytest
from commands import Outcome, run_command
from support import EXAMPLE

DATE = "2026-01-31"
FLEET_UNIT = EXAMPLE / "fleet" / "units" / "unit_01" / "parameters.json"


@dataclasses.dataclass(frozen=True)
class Export:
    """Writes results in a format, and gives the file and what the user saw."""

    folder: pathlib.Path

    def __call__(
        self, results: pathlib.Path, kind: str, *more: str, name: str = "export"
    ) -> tuple[pathlib.Path, Outcome]:
        out = self.folder / f"{name}.{kind}"
        return out, run_command("export", results, "--format", kind, "--out", out, "--date", DATE, *more)


@pytest.fixture
def export(tmp_path) -> Callable[..., tuple[pathlib.Path, Outcome]]:
    return Export(tmp_path)
