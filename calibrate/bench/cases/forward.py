"""One simulation: the default stepping beside other solvers and other tools."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax

import vgtjax

from .. import casadi_plant, numba_plant, scipy_plant
from ..data import reference
from ..served import Served
from ..table import Section, seconds, times
from ..timing import interleave
from ..workloads import SECONDS, forward, forward_trace

ROUNDS = 15
COLUMNS = ("contestant", "first call", "time", "ratio", "work", "x_d RMS um", "p_act RMS Pa")
_OURS = "vgtjax.simulate in jax.jit"
_PLAIN = "the same, plain JAX settings (only x64)"
_NUMBA = "numba RK4 at 0.5 ms, one core"


def measure() -> Section:
    """Times every contestant on one trace, and compares each with the reference states."""
    model, trace = vgtjax.Actuator(), forward_trace()
    theta = numba_plant.pack(model)
    cvodes = casadi_plant.CvodesPlant(trace)
    with Served("forward") as plain:
        contestants: dict[str, Callable[[], Any]] = {
            _OURS: forward(),
            _PLAIN: plain,
            "vgtjax.simulate, called as it is": lambda: _seen(vgtjax.simulate(model, trace)),
            "the same with diffrax.Heun": _heun(model, trace),
            "adaptive: diffrax.Tsit5, rtol 1e-6": _adaptive(model, trace, diffrax.Tsit5()),
            "adaptive: diffrax.Kvaerno3, rtol 1e-6": _adaptive(model, trace, diffrax.Kvaerno3()),
            _NUMBA: lambda: [found[0] for found in numba_plant.simulate(theta, trace)],
            "SciPy LSODA on numba, rtol 1e-6": lambda: scipy_plant.simulate(theta, trace),
            "CasADi CVODES, rtol 1e-6": lambda: cvodes.simulate(model),
        }
        timings, results = interleave(contestants, ROUNDS)
    results[_PLAIN] = results[_OURS]
    work = dict.fromkeys(contestants, _fixed_steps(trace))
    for name, solver in (("Tsit5", diffrax.Tsit5()), ("Kvaerno3", diffrax.Kvaerno3())):
        work[f"adaptive: diffrax.{name}, rtol 1e-6"] = _count_steps(model, trace, solver)
    work["SciPy LSODA on numba, rtol 1e-6"] = f"{results['SciPy LSODA on numba, rtol 1e-6'][2]:,} right sides"
    work["CasADi CVODES, rtol 1e-6"] = f"{cvodes.steps:,} steps"
    section = Section("One simulation", _about(trace), COLUMNS, notes=_NOTES)
    truth = reference("levels")
    for name, timing in timings.items():
        position, pressure = truth.errors(*results[name][:2])
        ratio = times(timing.ratio(timings[_OURS]))
        cells = (seconds(timing.first), seconds(timing.median), ratio, work[name])
        section.add(name, *cells, f"{position:.3f}", f"{pressure:.2f}")
    return section


_NOTES = [
    "Errors are over the 8 s of the reference: an independent plant, RK4 at 10 us, with hard switching. All JAX rows "
    "and CasADi open the leak at zero lift over a small lift, which costs most of their error.",
    "The reference starts with the plunger closed; every contestant here starts it in static balance.",
    "LSODA and CVODES are restarted at every duty jump, and the adaptive diffrax solvers are told of them.",
    "The first call compiles, except for CasADi, whose plant is built before. Of the plain settings it includes "
    "starting a process.",
]


def _about(trace: vgtjax.Trace) -> str:
    jumps = len(scipy_plant.stretches(trace)) - 1
    return (
        f"One {SECONDS:g} s trace at 1 kHz with {jumps} duty jumps, printed parameters, 7 states, double precision, "
        f"{ROUNDS} rounds."
    )


def _seen(solution: vgtjax.Solution) -> tuple[jax.Array, jax.Array]:
    return solution.x_d, solution.p_act


def _fixed_steps(trace: vgtjax.Trace) -> str:
    substeps = vgtjax.FixedStep().plan(vgtjax.Actuator(), trace).substeps
    return f"{(len(trace.time) - 1) * substeps:,} steps"


def _heun(model: vgtjax.Actuator, trace: vgtjax.Trace) -> Callable[[], tuple[jax.Array, jax.Array]]:
    stepping = vgtjax.FixedStep(solver=diffrax.Heun())
    run = jax.jit(lambda model: _seen(vgtjax.simulate(model, trace, stepping=stepping)))
    return lambda: run(model)


def _adaptive(
    model: vgtjax.Actuator,
    trace: vgtjax.Trace,
    solver: diffrax.AbstractSolver,
    adjoint: diffrax.AbstractAdjoint | None = None,
) -> Callable[[], tuple[jax.Array, jax.Array]]:
    stepping = vgtjax.AdaptiveStep(solver=solver)
    run = jax.jit(lambda model: _seen(vgtjax.simulate(model, trace, stepping=stepping, adjoint=adjoint)))
    return lambda: run(model)


def _count_steps(model: vgtjax.Actuator, trace: vgtjax.Trace, solver: diffrax.AbstractSolver) -> str:
    counts: list[int] = []

    class Counting(diffrax.AbstractAdjoint):
        """Forward mode that tells how many steps it took, which the states alone do not."""

        def loop(self, **arguments):
            """See the base class."""
            state, statistics = diffrax.ForwardMode().loop(**arguments)
            jax.debug.callback(lambda count: counts.append(int(count)), state.num_steps)
            return state, statistics

    jax.block_until_ready(_adaptive(model, trace, solver, Counting())())
    jax.effects_barrier()
    return f"{counts[-1]:,} steps"
