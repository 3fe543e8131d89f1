"""The numbers that the thesis states in chapters 2 to 5, each beside ours."""

from .rows import Found as Found, Result as Result, Row as Row
from .table import ROWS as ROWS, evaluate as evaluate
