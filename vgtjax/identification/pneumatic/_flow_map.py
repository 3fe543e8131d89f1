"""The polynomial flow map from bench traces, as the thesis made its maps (section 5.2.1)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..._errors import InputError
from ...plants import Actuator, FlowMapFit, assess_flow_map, fit_polynomial_flow
from ...traces import ASSUMED_RESERVOIR, Trace, noise_level
from .. import _limits as limits
from .._filters import smooth


def measured_flow(model: Actuator, trace: Trace) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Mass flow in kg/s into the chamber from measured pressure and position, and its standard deviation by noise.

    `m' = (V p' - p A_d v) / (R T_atm)`, the last line of [5.2] solved for the flow: an isothermal chamber. Of `model`
    only volume, area of the diaphragm and the properties of air count.
    """
    trace = trace.on_one_clock()
    assert trace.p_act is not None
    assert trace.x_d is not None
    pressure = smooth(trace.time, trace.p_act, noise_level(trace.p_act, "p_act"))
    position = smooth(trace.time, trace.x_d, noise_level(trace.x_d, "x_d"))
    area, air = float(model.diaphragm.area), model.air
    heat = float(air.gas_constant * air.temperature)
    volume = float(model.chamber.volume) - area * position.value
    flow = (volume * pressure.rate - pressure.value * area * position.rate) / heat
    return flow, np.hypot(volume * pressure.rate_error, pressure.value * area * position.rate_error) / heat


def fit_measured_flow(model: Actuator, traces: Sequence[Trace]) -> FlowMapFit:
    """[`PolynomialFlow`][] by least squares to the flow that traces determine, weighted by its noise.

    Its goodness counts that noise too. Traces at rest mostly determine where nothing flows; steps to several
    duties determine the slopes.

    **Raises:** `InputError` for a trace without duty, pressure or position, or when all of them together have one duty.
    """
    rows = []
    for trace in (trace.on_one_clock() for trace in traces):
        for column in ("pwm", "p_act", "x_d"):
            if getattr(trace, column) is None:
                raise InputError(
                    f"{trace.name}: a measured flow needs the column {column}, which is missing; record it"
                )
        assert trace.pwm is not None
        assert trace.p_act is not None
        flow, error = measured_flow(model, trace)
        changes = trace.time[np.flatnonzero(np.diff(trace.pwm)) + 1]
        last = np.searchsorted(changes, trace.time, side="right") - 1
        since = trace.time - np.append(changes, -np.inf)[last]
        gauge = trace.p_act - trace.atmosphere + float(model.air.pressure)
        rows.append(np.stack([trace.pwm, gauge, flow, error])[:, since > limits.MAP_SETTLING])
    duty, pressure, flow, error = np.concatenate(rows, axis=1) if rows else np.zeros((4, 0))
    if len(np.unique(duty)) < limits.MAP_DUTIES:
        raise InputError(
            f"a flow map needs traces with three duties or more, but these have {len(np.unique(duty))}; record others"
        )
    # A noise-free simulation still has the error of its differences.
    weight = 1 / np.hypot(error, 1e-3 * np.max(np.abs(flow)))
    flow_map = fit_polynomial_flow(
        duty,
        pressure,
        flow,
        weight / weight.max(),
        pressure_range=(float(pressure.min()), float(pressure.max())),
        ambient=float(model.air.pressure),
    )
    known = [float(np.mean(trace.p_res)) for trace in traces if trace.p_res is not None]
    reservoir = float(np.mean(known)) if known else ASSUMED_RESERVOIR
    return assess_flow_map(model, flow_map, duty, pressure, flow, (float(duty.min()), float(duty.max())), reservoir)
