"""The command `identify`: one bench test after the other."""

from .command import run as run
