"""Whether an observer that switches slides, for summaries, notes and the terminal."""

import dataclasses
from typing import Any

from vgtjax.tuning import Sliding


def list_sliding(found: Sliding | None) -> dict[str, Any] | None:
    """SI units; nothing for a controller without an observer that switches."""
    return None if found is None else {**dataclasses.asdict(found), "slides": found.slides, "sentence": found.sentence}


def warnings(found: Sliding | None) -> list[str]:
    """A sentence where an observer that switches does not slide."""
    return [] if found is None or found.slides else [found.sentence]
