"""Where the time of one unit of a fleet goes: `identify` and `fit` of its traces."""

import pathlib
import tempfile

from ..table import Section
from .first_answer import watch_commands
from .fleet import write_study


def measure() -> Section:
    """Watches both commands, with an empty and with a filled compilation cache."""
    with tempfile.TemporaryDirectory() as name:
        root = pathlib.Path(name)
        study = str(write_study(root / "unit", 1))
        found = str(root / "identify" / "0")
        commands = {"identify": ["identify", study], "fit": ["fit", study, "--parameters", found]}
        return watch_commands("A unit of a fleet", _ABOUT, commands, root)


_ABOUT = (
    "As `--only first-answer`, of one unit of `--only fleet`: three slow loops of 30 s at 100 Hz and random levels of "
    "5 s at 500 Hz. Each command begins with an empty cache of its own; the fit begins at what `identify` "
    "found."
)
