"""What a bench would record of an actuator whose parameters we know."""

import numpy as np
from support import duty_trace

import vgtjax
from vgtjax import simulate
from vgtjax.parts import with_sharp_seat

TRUTH = {"diaphragm.stiffness": 12600.0, "diaphragm.preload": 51.0, "chamber.volume": 57e-6}
FREE = list(TRUTH)
NOISE = {"x_d": 8e-6, "p_act": 60.0}


def bench(seed, truth=TRUTH, offset=(2e-5, -150.0)):
    """What a bench would record of an actuator whose parameters we know: noise, and an offset of each sensor."""
    trace = duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4)
    return _recorded(trace, simulate(vgtjax.replace_parameters(vgtjax.Actuator(), truth), trace), seed, offset)


def sharp_bench(seed, inputs=None):
    """The same without a smooth seat and with steps of 0.1 ms, which a fit's own simulator does not have."""
    trace = duty_trace((0, 0.05), (70, 0.35), (40, 0.3), (60, 0.3), p_res=2.0e4) if inputs is None else inputs
    plant = with_sharp_seat(vgtjax.replace_parameters(vgtjax.Actuator(), TRUTH))
    return _recorded(trace, simulate(plant, trace, stepping=vgtjax.FixedStep(1e-4)), seed, (2e-5, -150.0))


def _recorded(trace, run, seed, offset):
    rng = np.random.default_rng(seed)
    return vgtjax.Trace(
        time=trace.time,
        pwm=trace.pwm,
        p_res=trace.p_res,
        x_d=np.asarray(run.x_d) + offset[0] + rng.normal(0, NOISE["x_d"], len(trace.time)),
        p_act=np.asarray(run.p_act) + offset[1] + rng.normal(0, NOISE["p_act"], len(trace.time)),
        name=trace.name,
    )


def missed_when_applied(found, trace):
    """By how much a simulation of what a fit found, with the duty that it found, misses what the fit shows of a trace:
    position in m and chamber pressure in Pa."""
    applied = found.applied(trace)
    run, shown = simulate(found.model, applied), found.trace(trace.name).simulated
    rows = applied.rows_at(trace.time)
    return [float(np.max(np.abs(np.asarray(run.signals[name])[rows] - shown[name]))) for name in ("x_d", "p_act")]
