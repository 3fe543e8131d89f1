"""What several tests need: reference runs, traces made of duty steps, a norm."""

import contextlib
import os
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import vgtjax
from vgtjax.estimation.derivatives import _programs
from vgtjax.parts.vane_force import _stage_table

DATA = pathlib.Path(__file__).parent / "data"
EXAMPLE = pathlib.Path(__file__).parents[1] / "calibrate" / "example"


def reference(name: str) -> dict[str, np.ndarray]:
    """What other programs have computed: noise-free states of a plant (RK4 at 10 us, hard switching) with the printed
    parameters, and steady gas flows (`gas_flow`)."""
    return dict(np.load(DATA / f"reference_{name}.npz"))


def reference_trace(name: str) -> vgtjax.Trace:
    """The inputs of a reference run; it starts at rest with the chamber at atmosphere."""
    states = reference(name)
    return vgtjax.Trace(time=states["time"], pwm=states["pwm"], p_res=states["p_res"])


def duty_trace(*levels: tuple[float, float], interval: float = 1e-3, **signals: float) -> vgtjax.Trace:
    """A trace whose duty is held at `levels`, pairs of percent and seconds."""
    pwm = np.concatenate([np.full(round(seconds / interval), duty) for duty, seconds in levels])
    time = np.arange(len(pwm)) * interval
    filled = {name: np.full_like(time, value) for name, value in signals.items()}
    return vgtjax.Trace(time=time, pwm=pwm, **filled)


@contextlib.contextmanager
def optimised() -> Iterator[None]:
    """Around what runs for longer than the optimisation of its programs takes, which tests else go without."""
    jax.clear_caches()  # what has been compiled without it
    jax.config.update("jax_disable_most_optimizations", False)
    try:
        yield
    finally:
        jax.config.update("jax_disable_most_optimizations", True)


@contextlib.contextmanager
def kept_programs(factory: pytest.TempPathFactory) -> Iterator[None]:
    """Around what replaces nothing that programs are made of: those of fits are on disk, where all processes of the
    tests find them. To trace and lower them again takes as long as to compile them did."""
    own = factory.getbasetemp()  # of each process of xdist inside of one of all
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "programs"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vgtjax._kept, "FOLDER", folder)
        # A thread that compiles ahead would go on in the next test.
        patch.setattr(_programs, "preparing", lambda *_: contextlib.nullcontext())
        yield
    for name, module in list(sys.modules.items()):
        for each in vars(module).values() if name.startswith("vgtjax") else ():
            if isinstance(each, vgtjax._kept.Kept):
                each._programs.clear()  # what is loaded takes memory, see `_forget_compiled`


@contextlib.contextmanager
def quick_nozzle() -> Iterator[None]:
    """Turbines whose tables take no flows: like that of the default nozzle, in proportion to the lead of the vanes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_stage_table, "solve_table", _valley)
        _stage_table._remembered.cache_clear()
        yield
    _stage_table._remembered.cache_clear()


def _valley(stage, rows):
    """20 N closed, 9 N in the valley, 40 N open at 4.5 bar."""
    pressure, angle = jnp.meshgrid(jnp.linspace(0, 1, _stage_table.PRESSURES), jnp.linspace(0, 1, _stage_table.ANGLES))
    force = pressure * (9 + 11 * (1 - angle) ** 8 + 31 * angle**2) * stage.nozzle.lead / 7e-3
    table = jnp.stack([force.T, 0.2 * (pressure * angle).T])
    return table, jnp.broadcast_to(jnp.asarray(rows)[:, None], table.shape[1:])


def forward_mode(function, theta) -> np.ndarray:
    """`jax.jacfwd`, one direction after the other, which compiles in half the time."""
    theta = jnp.asarray(theta)

    def along(direction):
        return jax.jvp(function, (theta,), (direction,))[1]

    columns = jax.jit(lambda directions: jax.lax.map(along, directions))(jnp.eye(len(theta)))
    return np.moveaxis(np.asarray(columns), 0, -1)


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def assert_recovered(result: Any, truth: dict[str, float], worst: dict[str, float]) -> None:
    """What was identified is these values to within four of its errors, which are no larger relatively than `worst`."""
    assert set(result.values) == set(truth)
    for name, true in truth.items():
        value, error = float(result.values[name]), float(result.std_errors[name])
        assert abs(value - true) < 4 * error, f"{name}: {value} +- {error}, not {true}"
        assert error < worst[name] * abs(true), f"{name}: {value} +- {error}"
