"""The command `tolerance`: a Monte Carlo study."""

from .command import run as run
