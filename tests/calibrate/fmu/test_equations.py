"""Every model in C is the model in JAX: its start, its steps, its derivatives, its signals."""

import jax
import numpy as np
import pytest
from support import EXAMPLE, quick_nozzle

import vgtjax
from calibrate.fmu.entries import values_of, with_values
from calibrate.fmu.equations import START, Equations
from calibrate.study.components import FRICTION, VANE_FORCE
from vgtjax.parts import tabulated
from vgtjax.simulation import FixedStep

from .variants import VARIANTS, build

STEPS = 600


@pytest.fixture(scope="module", autouse=True)
def _tables_of_no_flow():
    """How C reads a table is the same whatever solved flows would fill it with, which takes long."""
    with quick_nozzle():
        yield


@pytest.fixture(scope="module")
def trace() -> vgtjax.Trace:
    """A duty step at a rising turbine pressure and a sagging supply."""
    trace = vgtjax.load_trace(EXAMPLE / "step_80.csv").window(0.0, 0.001 * STEPS)
    return trace.replace(p_trb=np.linspace(1e5, 2.5e5, len(trace.time)), p_res=2e4 + 3e3 * np.sin(9 * trace.time))


def inputs(equations: Equations, trace: vgtjax.Trace) -> np.ndarray:
    """The inputs over every interval, as C takes them."""
    drive = trace.drive()
    ramps = {"p_res": drive.reservoir, "p_trb": drive.turbine, "p_act": drive.chamber}
    columns = [drive.duration, np.asarray(drive.ambient_shift)]
    for name in equations.inputs:
        ramp = ramps.get(name)
        columns += [drive.pwm, 0 * drive.duration] if ramp is None else [ramp.start, ramp.rate]
    return np.array(np.broadcast_arrays(*columns)).T


def test_all_components_are_among_the_variants():
    assert set(FRICTION) <= {components.get("friction") for _, components in VARIANTS.values()}
    assert {*VANE_FORCE} - {"none"} <= {components.get("vane_force") for _, components in VARIANTS.values()}


@pytest.mark.parametrize("name", VARIANTS)
def test_c_simulates_what_the_library_simulates(load, trace, name):
    """With parameters other than those it was emitted for: they stay variables."""
    emitted = tabulated(build(name))
    equations = Equations(emitted)
    call = load(equations.to_c())
    p = values_of(equations.model) * (1 + 0.01 * np.cos(np.arange(len(equations.entries))))
    model = with_values(emitted, jax.numpy.asarray(p))
    solution = vgtjax.simulate(model, trace)
    substeps = FixedStep().plan(model, trace).substeps
    begin = trace.start()
    s = np.array([float(np.asarray(getattr(begin, field))) for field in START])
    us, found = inputs(equations, trace), {signal: [] for signal in equations.signals}
    x = call("vg_start", len(equations.states), p, s, us[0])
    for u in us:
        for signal, value in zip(found, call("vg_reports", len(found), p, u, x), strict=True):
            found[signal].append(value)
        for step in range(substeps):
            length = u[0] / substeps
            x = call("vg_step", len(x), p, u, x, step * length, length)
    assert set(found) == set(solution.signals) - set(equations.inputs)
    for signal, values in found.items():
        expected = np.asarray(solution.signals[signal])
        # Rounding: 1200 steps, between which stick and slip amplify a difference.
        np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-10 * np.max(np.abs(expected)))


@pytest.mark.parametrize("name", ["friction-lugre", "vane-force-map", "static-map-polynomial"])
def test_derivatives_are_the_vector_field(load, trace, name):
    equations = Equations(build(name))
    call = load(equations.to_c())
    p, u = values_of(equations.model), inputs(equations, trace)[300]
    state = np.asarray(jax.tree.leaves(equations.model.typical_state()), float)
    expected = np.asarray(equations.derivatives(*map(jax.numpy.asarray, (p, u, state))))
    np.testing.assert_allclose(call("vg_derivatives", len(state), p, u, state), expected, rtol=1e-12)
