"""What the small fit has written."""

import pytest
from commands import read


@pytest.fixture
def parameters(fitted):
    return read(fitted.out / "parameters.json")["parameters"]


@pytest.fixture
def summary(fitted):
    return read(fitted.out / "summary.json")
