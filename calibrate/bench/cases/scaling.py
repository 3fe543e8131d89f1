"""Cost against size, as curves with their exponents, and what the machine could do."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.traces import cast

from ..data import example_traces, lengthened, reference, seconds_of
from ..roofline import byte_time, operation_times, operations, processor_time
from ..table import Section, seconds
from ..timing import interleave

ROUNDS = 3
LENGTHS = (1.0, 3.0, 10.0, 30.0, 100.0)
"""s of one trace."""
PARAMETERS = (5, 10, 20, 40, 80)
LANES = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)
SHORT = 0.05
"""s that each of many actuators is simulated for, so that a million of them take seconds."""
STEPS_A_SECOND = 2000
"""The default steps of 0.5 ms."""
COLUMNS = ("curve", "sizes", "times", "exponent", "last, each")


def measure() -> Section:
    """Times every curve, and puts the work of a step beside what the machine can do."""
    section = Section("Scaling", _about(), COLUMNS)
    trace = reference("levels").trace
    _add(section, "simulate, s of trace", LENGTHS, [_simulation(lengthened(trace, length)) for length in LENGTHS])
    model, traces = vgtjax.Actuator(vane_force=_vanes()), example_traces()
    free = vgtjax.select(model, ["*"]).entries
    jacobians = [partial(vgtjax.jacobian, model, traces, list(free[:size])) for size in PARAMETERS]
    _add(section, f"jacobian of {seconds_of(traces):.0f} s, parameters", PARAMETERS, jacobians)
    short = lengthened(trace, SHORT)
    for dtype in (jnp.float64, jnp.float32):
        batches = [_batch(short, lanes, dtype) for lanes in LANES]
        _add(section, f"batch of {SHORT:g} s, {dtype.__name__}, lanes", LANES, batches)
    section.notes += [_roofline(short, dtype) for dtype in (jnp.float64, jnp.float32)]
    return section


def _about() -> str:
    return (
        f"One process on {jax.device_count()} devices, the printed actuator at 1 kHz with steps of 0.5 ms, {ROUNDS} "
        "rounds after the first. The exponent is the slope of log time over log size through the upper half of a "
        "curve: 1 is proportional."
    )


def _vanes() -> vgtjax.SpeedMap:
    """Tables with more entries than those by default: 84 parameters in all."""
    pressures, angles = jnp.linspace(5e4, 3e5, 3), vgtjax.SpeedMap().crank_angle
    force = jnp.linspace(1.0, 20.0, len(pressures) * len(angles))
    return vgtjax.SpeedMap(closing=force, opening=force - 0.5, turbine_pressure=pressures)


def _add(section: Section, curve: str, sizes: Sequence[float], contestants: Sequence[Callable[[], Any]]) -> None:
    timings, _ = interleave(dict(zip(map(str, sizes), contestants, strict=True)), ROUNDS)
    medians = [timing.median for timing in timings.values()]
    upper = slice(len(sizes) // 2, None)
    slope = float(np.polyfit(np.log(sizes[upper]), np.log(medians[upper]), 1)[0])
    shown = (" ".join(f"{size:g}" for size in sizes), " ".join(map(seconds, medians)))
    section.add(curve, *shown, f"{slope:.2f}", seconds(medians[-1] / sizes[-1]))


def _simulation(trace: vgtjax.Trace) -> Callable[[], Any]:
    model = vgtjax.Actuator()
    run = jax.jit(lambda model: vgtjax.simulate(model, trace).x_d)
    return lambda: run(model)


def _population(lanes: int, dtype: Any) -> vgtjax.Actuator:
    """Printed actuators whose stiffness differs."""
    model = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf.astype(dtype), (lanes, *leaf.shape)), vgtjax.Actuator())
    factor = jnp.linspace(0.9, 1.1, lanes, dtype=dtype)
    return eqx.tree_at(lambda model: model.diaphragm.stiffness, model, model.diaphragm.stiffness * factor)


def _batch(trace: vgtjax.Trace, lanes: int, dtype: Any) -> Callable[[], Any]:
    """The last position of every lane: what a million actuators leave must fit into memory."""
    population = _population(lanes, dtype)
    run = jax.jit(jax.vmap(lambda model: vgtjax.simulate(model, trace, throw=False).x_d[-1]))
    return lambda: run(population)


def _roofline(trace: vgtjax.Trace, dtype: Any) -> str:
    """What a step takes, beside what its operations and its bytes would take by themselves."""
    lanes = 10_000
    population, march = _population(lanes, dtype), vgtjax.FixedStep().plan_intervals(vgtjax.Actuator(), 5e-4)
    drive, start = jax.tree.map(lambda leaf: leaf[0], cast(trace.drive(), dtype)), cast(trace.start(), dtype)
    state = jax.vmap(lambda model: model.start(start, drive))(population)
    step = jax.jit(jax.vmap(lambda model, state: march.advance(model, state, drive)[0]))
    compiled = step.lower(population, state).compile()
    cost: Any = compiled.cost_analysis()
    moved, counts, each = cost["bytes accessed"] / lanes, operations(compiled.as_text() or ""), operation_times(dtype)
    took = processor_time(_batch(trace, lanes, dtype)) / (lanes * SHORT * STEPS_A_SECOND)
    parts = {name: count * each[name] * 1e9 for name, count in counts.items()}
    listed = ", ".join(f"{counts[name]} {name} {part:.1f} ns" for name, part in parts.items())
    return (
        f"{np.dtype(dtype).name}, {lanes} lanes: a step takes {took * 1e9:.0f} ns of a processor. Its operations, as "
        f"they are in the compiled program, take {sum(parts.values()):.0f} ns where each kind runs by itself on "
        f"vectors in the caches ({listed}), and its {moved:.0f} bytes {moved * byte_time(dtype) * 1e9:.0f} ns if all "
        "of them went to memory."
    )
