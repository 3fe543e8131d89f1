"""Files of loggers: a reader for each kind, which turns a file into channels by name."""

from ._open import SUFFIXES as SUFFIXES, open_recording as open_recording
from ._recording import Entry as Entry, Record as Record, Recording as Recording
