"""The command `fit`: calibrates every unit of a study."""

from .command import run as run
