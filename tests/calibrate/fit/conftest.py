"""What the small fit has written."""

import pytest
from commands import read

import vgtjax

FREE = {"converter.magnetic_force[2]", "diaphragm.preload", "diaphragm.stiffness", "friction.viscous_damping"}


@pytest.fixture(scope="module", autouse=True)
def _kept(kept):
    """Every file fits the small study, or another that several of them share."""


@pytest.fixture
def parameters(fitted):
    return read(fitted.out / "parameters.json")["parameters"]


@pytest.fixture
def summary(fitted):
    return read(fitted.out / "summary.json")


@pytest.fixture(scope="session")
def calibration(fitted):
    """The study of the command, as a user of the library writes it."""
    fit, validate = (
        vgtjax.load_trace(fitted.study.parent / f"{name}.csv", atmosphere=atmosphere)
        for name, atmosphere in (("step_80", 101013.0), ("step_50", 101100.0))
    )
    return vgtjax.fit(
        vgtjax.Actuator(),
        [fit],
        [validate],
        free=sorted(FREE),
        values={"diaphragm.stiffness": 11500.0},
        bounds={"diaphragm.stiffness": (8000.0, 16000.0)},
    )
