"""Files of loggers: a reader for each kind, which turns a file into channels by name."""

from ._open import (
    open_recording as open_recording,
    register_reader as register_reader,
    trace_suffixes as trace_suffixes,
)
from ._recording import (
    Entry as Entry,
    Record as Record,
    Recording as Recording,
    reading as reading,
    require_start as require_start,
)
