"""Whether random actuators are simulated at default settings, and how well: much smaller steps are the measure."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.parameters import entry_names, parameter_table
from vgtjax.plants import least_volume
from vgtjax.population import Factors, choose_factors
from vgtjax.simulation import RESULTS, FixedMarch, FixedStep, march
from vgtjax.traces import cast

from ..table import Section

DRAWS = 4096
LANES = 512
FINE = 2e-5
"""s."""
SPREADS = (0.1, 0.3, 0.5)
SEEDS = (7, 8, 9)
Runner = Callable[[np.ndarray], tuple[jax.Array, jax.Array]]


def measure() -> Section:
    """Draws actuators around the printed one, lets those that are physical follow steps of the duty, and counts."""
    section = Section(
        "Random actuators at default steps",
        f"{DRAWS} actuators for each row, every parameter lognormal around the printed one, entries of vectors "
        "each by itself, air as it is. Physical are those with passive friction and a chamber larger than what the rod "
        "sweeps; whether it has room for the give of the stop is not asked. 6 s of duty steps, 1 kHz.",
        ("spread", "seed", "physical", "diverged", "median RMS error", "99 %", "within 20 um"),
    )
    duty = np.repeat([0.0, 100, 0, 80, 40, 95, 0], [200, 2000, 1000, 1000, 500, 700, 600])
    trace = vgtjax.Trace(np.arange(len(duty)) * 1e-3, pwm=duty)
    nominal = vgtjax.Actuator()
    plans = [plan.plan_intervals(nominal, trace.longest_interval) for plan in (FixedStep(), FixedStep(max_step=FINE))]
    factors = varied(nominal)
    run, fine = (runner(nominal, factors, trace, plan) for plan in plans)
    for spread in SPREADS:
        for seed in SEEDS:
            rows = physical(nominal, factors, draw(nominal, factors, spread, DRAWS, seed))
            section.add(f"{100 * spread:.0f} %", f"{seed}", *_row(run, fine, rows))
    section.notes.append(f"Errors of the position against steps of {FINE * 1e6:.0f} us, of the first {LANES}; one that")
    section.notes[-1] += " has diverged counts as infinite."
    return section


def varied(nominal: vgtjax.Actuator) -> Factors:
    """All entries but those of the air."""
    entries = entry_names(parameter_table(nominal))
    return choose_factors(nominal, [name for name in entries if not name.startswith("air.")])


def draw(nominal: vgtjax.Actuator, factors: Factors, spread: float, count: int, seed: int) -> np.ndarray:
    """Actuators whose entries are lognormal and independent, with the printed ones as medians, one per row."""
    normal = np.random.default_rng(seed).standard_normal((count, len(factors.entries)))
    return np.asarray(factors.pack(nominal)) * np.exp(spread * normal)


def physical(nominal: vgtjax.Actuator, factors: Factors, rows: np.ndarray) -> np.ndarray:
    """Those with passive friction and, as the library has it, a chamber that the diaphragm does not swallow."""

    def margins(row: jax.Array) -> tuple[Any, Any]:
        model = factors.unpack(nominal, row)
        left = least_volume(model)
        assert left is not None
        return left, model.friction.passivity_margin()

    left, passive = (np.asarray(each) for each in eqx.filter_jit(jax.vmap(margins))(jnp.asarray(rows)))
    return rows[(left > 0) & (passive > 0)]


def _row(run: Runner, fine: Runner, rows: np.ndarray) -> tuple[str, ...]:
    """What a row of the table counts."""
    chunks = [run(np.resize(rows[begin:], (LANES, rows.shape[1]))) for begin in range(0, len(rows), LANES)]
    position, good = (np.concatenate([np.asarray(chunk[i]) for chunk in chunks])[: len(rows)] for i in range(2))
    compared = min(LANES, len(rows))
    exact = np.asarray(fine(np.resize(rows, (LANES, rows.shape[1])))[0])[:compared]
    errors = np.full(compared, np.inf)
    kept = good[:compared]
    errors[kept] = np.sqrt(np.mean((position[:compared][kept] - exact[kept]) ** 2, axis=1))
    return (
        f"{len(rows)}",
        f"{int(np.sum(~good))}",
        f"{1e6 * np.median(errors):.2f} um",
        f"{1e6 * np.quantile(errors, 0.99, method='higher'):.1f} um",
        f"{100 * np.mean(errors < 20e-6):.1f} %",
    )


def runner(nominal: vgtjax.Actuator, factors: Factors, trace: vgtjax.Trace, plan: FixedMarch) -> Runner:
    """Positions `(lanes, time)` of actuators, one per row, and which of them stayed finite."""
    drive, start = cast((trace.drive(), trace.start()), np.dtype(float))

    @eqx.filter_jit
    def run(rows: Any) -> tuple[jax.Array, jax.Array]:
        def one(row: jax.Array) -> tuple[jax.Array, jax.Array]:
            model = factors.unpack(nominal, row)
            states, result = march(model, drive, start, plan)
            return jax.vmap(model.observe)(states, drive)[0], result == RESULTS.successful

        return jax.vmap(one)(rows)

    return run
