"""The command `sensitivity`: which spread what comes from."""

from .command import run as run
