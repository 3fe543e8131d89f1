"""Derivatives of five traces by 25 parameters: exact and parallel, plain forward mode, and finite differences."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import vgtjax
from vgtjax.estimation import NULL

from .. import casadi_plant, numba_plant
from ..data import example_traces, reference, seconds_of
from ..served import Served
from ..table import Section, seconds, times
from ..timing import interleave
from ..workloads import HELD, forward_mode

ROUNDS = 5
STEP = 1e-3
"""Relative step of the finite differences: smaller ones measure the noise of hard switching, larger ones curvature."""
FINE = 5e-5
"""Step in s behind both kinds of reference derivatives."""
COLUMNS = ("contestant", "first call", "time", "per s of trace", "ratio", "off differences", "off exact")
_OURS = "vgtjax.jacobian"
_SINGLE = "the same, all in single precision"
_FORWARD_MODE = "jax.jacfwd through vgtjax.simulate"
_PLAIN = "the same, plain JAX settings (only x64)"
_CASADI = "CasADi CVODES forward sensitivities"


def measure() -> Section:
    """Times every contestant on the example's fit traces, and CasADi on one reference trace."""
    model, traces = vgtjax.Actuator(), example_traces()
    single = jax.tree.map(lambda leaf: leaf.astype(np.float32), model)
    short = [reference("step_80").trace]
    selection = vgtjax.select(model, fixed=HELD)
    sensitivities = casadi_plant.CvodesPlant(short[0]).jacobian(selection.entries)
    differences = _Differences(model, selection)
    with Served("forward-mode") as plain:
        contestants: dict[str, Callable[[], Any]] = {
            _OURS: lambda: vgtjax.jacobian(model, traces, fixed=HELD),
            _SINGLE: lambda: vgtjax.jacobian(single, traces, fixed=HELD),
            _FORWARD_MODE: forward_mode(traces),
            _PLAIN: plain,
            "numba RK4 differences, one core": lambda: differences.one_sided(traces, parallel=False),
            "numba RK4 differences, all cores": lambda: differences.one_sided(traces, parallel=True),
            _CASADI: lambda: sensitivities(model),
        }
        timings, results = interleave(contestants, ROUNDS)
    results[_PLAIN] = results[_FORWARD_MODE]
    derivatives = results[_CASADI].reshape(2, -1, len(selection.entries)).transpose(1, 0, 2)
    results[_CASADI] = [derivatives]
    truths = {False: _truths(model, traces, differences), True: _truths(model, short, differences)}
    section = Section("Jacobian", _about(traces, selection), COLUMNS, notes=_notes(results, traces, short))
    for name, timing in timings.items():
        alone = name == _CASADI
        length = seconds_of(short if alone else traces)
        ratio = times(timing.ratio(timings[_OURS]) * seconds_of(traces) / length)
        errors = [f"{_error(results[name], truth):.1%}" for truth in truths[alone]]
        cells = (seconds(timing.first), seconds(timing.median), seconds(timing.median / length))
        section.add(name, *cells, f"{ratio} (scaled)" if alone else ratio, *errors)
    return section


def _truths(
    model: vgtjax.Actuator, traces: list[vgtjax.Trace], differences: "_Differences"
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Central differences of the plant with hard switching, and exact derivatives of the model, with fine steps."""
    stepping = vgtjax.FixedStep(max_step=FINE)
    exact = vgtjax.jacobian(model, traces, fixed=HELD, stepping=stepping)
    return differences.central(traces), [np.asarray(columns) for columns in exact]


def _about(traces: list[vgtjax.Trace], selection: vgtjax.Selection) -> str:
    return (
        f"{len(traces)} traces of {seconds_of(traces):.1f} s together at 1 kHz (the fit traces of the example), two "
        f"signals by {len(selection.entries)} parameters at their printed values, {ROUNDS} rounds; fixed steps of "
        f"0.5 ms, {2 * sum(len(trace.time) - 1 for trace in traces):,} in all."
    )


def _notes(results: dict[str, Any], traces: list[vgtjax.Trace], short: list[vgtjax.Trace]) -> list[str]:
    plain = results[_FORWARD_MODE]
    gap = max(float(np.max(apart)) for apart in _apart(results[_OURS], plain))
    rounded = np.concatenate([apart.ravel() for apart in _apart(results[_SINGLE], results[_OURS])])
    return [
        f"CasADi ran on one trace of {seconds_of(short):.1f} s only, because its reservoir pressure must be constant; "
        f"its ratio is scaled to the {seconds_of(traces):.1f} s of the others.",
        "How far a column (a signal of a trace by a parameter) is off, |J - J0| / |J0|, the median of all columns. J0 "
        f"is central differences with a relative step of {STEP:g} of the plant with hard switching, RK4 at "
        f"{FINE * 1e3:g} ms; or the exact derivative of this package's model at that step.",
        "Differences are no truth where the plunger grazes zero, as it does all along a ramp of the duty: there a few "
        "samples of any difference, also of J0, are off by more than the derivative itself.",
        f"vgtjax.jacobian and forward mode differ by at most {gap:.0e} of a column; single precision differs by "
        f"{np.median(rounded):.0e} in the median and {np.max(rounded):.0%} at most. That is as near to exact "
        f"derivatives, but not enough for a fit, which takes directions above {NULL:.0e} of the largest for real.",
        f"The differences are one-sided with a relative step of {STEP:g}: one run a parameter and one more.",
    ]


def _apart(found: list[Any], others: list[Any]) -> list[np.ndarray]:
    """By what part of the others' columns those of each trace differ."""
    pairs = [(np.asarray(a, float), np.asarray(b, float)) for a, b in zip(found, others, strict=True)]
    return [np.linalg.norm(a - b, axis=0) / (np.linalg.norm(b, axis=0) + 1e-300) for a, b in pairs]


def _error(found: list[Any], truth: list[np.ndarray]) -> float:
    errors = []
    for block, exact in zip(found, truth, strict=True):
        size = np.linalg.norm(exact, axis=0)
        errors.append((np.linalg.norm(np.asarray(block) - exact, axis=0)[size > 0]) / size[size > 0])
    return float(np.median(np.concatenate(errors)))


class _Differences:
    """Finite differences of the numba plant by the chosen parameters, `(time, 2, parameters)` a trace."""

    def __init__(self, model: vgtjax.Actuator, selection: vgtjax.Selection):
        self._theta = numba_plant.pack(model)
        self._where = [numba_plant.ENTRIES.index(entry) for entry in selection.entries]
        self._steps = STEP * np.abs(self._theta[self._where])

    def _moved(self, sign: float) -> np.ndarray:
        thetas = np.tile(self._theta, (len(self._where), 1))
        thetas[np.arange(len(self._where)), self._where] += sign * self._steps
        return thetas

    def one_sided(self, traces: list[vgtjax.Trace], *, parallel: bool) -> list[np.ndarray]:
        """As a user would: the plain run and one more a parameter."""
        found = []
        for trace in traces:
            seen = numba_plant.simulate(np.vstack([self._theta, self._moved(1)]), trace, parallel=parallel)
            found.append(np.stack([(s[1:] - s[0]) / self._steps[:, None] for s in seen]).transpose(2, 0, 1))
        return found

    def central(self, traces: list[vgtjax.Trace]) -> list[np.ndarray]:
        """Two runs per parameter with fine steps."""
        found = []
        for trace in traces:
            up, down = (
                np.stack(numba_plant.simulate(self._moved(sign), trace, parallel=True, max_step=FINE))
                for sign in (1, -1)
            )
            found.append(((up - down) / (2 * self._steps[:, None])).transpose(2, 0, 1))
        return found
