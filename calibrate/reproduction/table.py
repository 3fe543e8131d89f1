"""All rows in the order of the thesis's sections."""

from collections.abc import Iterator

from . import (
    air_flow,
    chamber,
    closed_loops,
    friction,
    gas_flow,
    identified,
    line,
    loops,
    reduced_models,
    responses,
    sensitivity,
    sensitivity_friction,
    sensitivity_table,
    solenoid,
    validation,
    vanes,
)
from .rows import Result, Row

TOPICS = (
    solenoid,
    air_flow,
    line,
    chamber,
    validation,
    responses,
    friction,
    vanes,
    gas_flow,
    loops,
    identified,
    sensitivity,
    sensitivity_table,
    sensitivity_friction,
    reduced_models,
    closed_loops,
)
ROWS: tuple[Row, ...] = tuple(sorted((row for topic in TOPICS for row in topic.ROWS), key=lambda row: row.section))


def evaluate(*, slow: bool = True) -> Iterator[Result]:
    """Every row with our value and the verdict, one after the other; without the slow ones if so asked."""
    return (row.evaluate() for row in ROWS if slow or not row.slow)
