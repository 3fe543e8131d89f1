"""The two operating points of the reference, and their cycles."""

import pytest

from vgtjax.exhaust import Engine, OperatingPoint, Pulsation, pulsation

SLOW = OperatingPoint(1000.0, 0.476e-3, 1150.0, 1.03e5, 87e-6)
FAST = OperatingPoint(2000.0, 0.571e-3, 1000.0, 1.05e5, 185e-6)


@pytest.fixture(scope="session")
def slow() -> OperatingPoint:
    return SLOW


@pytest.fixture(scope="session")
def cycles() -> dict[int, Pulsation]:
    """By engine speed in rpm."""
    return {1000: pulsation(Engine(), SLOW), 2000: pulsation(Engine(), FAST)}
