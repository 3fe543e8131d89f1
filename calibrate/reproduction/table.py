"""All rows in the order of the thesis's sections."""

from collections.abc import Iterator

from . import air_flow, chamber, friction, identified, line, loops, responses, solenoid, validation, vanes
from .rows import Result, Row

ROWS: tuple[Row, ...] = tuple(
    sorted(
        (
            row
            for topic in (solenoid, air_flow, line, chamber, validation, responses, friction, vanes, loops, identified)
            for row in topic.ROWS
        ),
        key=lambda row: row.section,
    )
)


def evaluate(*, slow: bool = True) -> Iterator[Result]:
    """Every row with our value and the verdict, one after the other; without the slow ones if so asked."""
    return (row.evaluate() for row in ROWS if slow or not row.slow)
