"""Whether random actuators are simulated at default settings, and how well: much smaller steps are the measure."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.population import make_sample, spread_population
from vgtjax.simulation import RESULTS, FixedMarch, FixedStep, march
from vgtjax.traces import cast

from ..table import Section

DRAWS = 4096
LANES = 512
FINE = 2e-5
"""s."""
SPREADS = (0.1, 0.3, 0.5)
SEED = 7


def measure() -> Section:
    """Draws actuators around the printed one, lets those that are physical follow steps of the duty, and counts."""
    section = Section(
        "Random actuators at default steps",
        f"{DRAWS} actuators for each spread, all parameters lognormal and independent; counted are those with passive "
        "friction and a chamber larger than what the rod sweeps and its stop gives. 6 s of duty steps, 1 kHz.",
        ("spread", "physical", "diverged", "median RMS error", "99 %", "within 20 um"),
    )
    duty = np.repeat([0.0, 100, 0, 80, 40, 95, 0], [200, 2000, 1000, 1000, 500, 700, 600])
    trace = vgtjax.Trace(np.arange(len(duty)) * 1e-3, pwm=duty)
    for spread in SPREADS:
        section.add(*_measure(trace, spread))
    section.notes.append(f"Errors of the position against steps of {FINE * 1e6:.0f} us, of the first {LANES}.")
    return section


def _measure(trace: vgtjax.Trace, spread: float) -> tuple[str, ...]:
    """A row of the table."""
    nominal = vgtjax.Actuator()
    names = spread_population(nominal).factors.entries
    spreads = {name: vgtjax.population.Spread("lognormal", relative=spread) for name in names}
    population = spread_population(nominal, spreads=spreads, vary=[])
    rows = population.values(make_sample(population.dimensions, DRAWS, "sobol", SEED).points(0, DRAWS))
    judge = eqx.filter_jit(jax.vmap(lambda row: _is_physical(population.factors.unpack(nominal, row))))
    rows = rows[np.asarray(judge(rows))]
    run = _runner(population, trace, FixedStep().plan_intervals(nominal, trace.longest_interval))
    fine = _runner(population, trace, FixedStep(max_step=FINE).plan_intervals(nominal, trace.longest_interval))
    chunks = [run(np.resize(rows[begin:], (LANES, rows.shape[1]))) for begin in range(0, len(rows), LANES)]
    position, good = (np.concatenate([np.asarray(chunk[i]) for chunk in chunks])[: len(rows)] for i in range(2))
    exact = np.asarray(fine(rows[:LANES])[0])
    errors = np.sqrt(np.mean((position[:LANES] - exact) ** 2, axis=1))
    return (
        f"{100 * spread:.0f} %",
        f"{len(rows)}",
        f"{int(np.sum(~good))}",
        f"{1e6 * np.median(errors):.2f} um",
        f"{1e6 * np.quantile(errors, 0.99):.1f} um",
        f"{100 * np.mean(errors < 20e-6):.1f} %",
    )


def _is_physical(model: vgtjax.Actuator) -> jax.Array:
    body = model.diaphragm
    give = model.air.pressure * body.area / body.stop_stiffness
    margin = model.friction.passivity_margin()
    return (jnp.asarray(margin) > 0) & (model.chamber.volume > body.area * (body.travel + give))


def _runner(population: vgtjax.population.Population, trace: vgtjax.Trace, plan: FixedMarch):
    drive, start = cast((trace.drive(), trace.start()), np.dtype(float))

    @eqx.filter_jit
    def run(rows):
        def one(row):
            model = population.factors.unpack(population.model, row)
            states, result = march(model, drive, start, plan)
            return jax.vmap(model.observe)(states, drive)[0], result == RESULTS.successful

        return jax.vmap(one)(rows)

    return run
