"""Hysteresis of measured and simulated loops, for summaries and reports."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from vgtjax.estimation import TraceResult
from vgtjax.experiments import HysteresisLoop, find_loop

from .figures import LABEL, PALETTE, curve, loop_curves, measured_pair, points, styled

POINTS = 1200


@dataclasses.dataclass(frozen=True, eq=False)
class LoopPair:
    """A measured loop and the simulated one, read at the same positions; `turbine` in Pa gauge."""

    result: TraceResult
    turbine: float
    measured: HysteresisLoop
    simulated: HysteresisLoop

    @property
    def widths(self) -> dict[str, float]:
        """Mean widths over 2 to 8 mm of travel in Pa."""
        return {"measured": self.measured.mean_width, "simulated": self.simulated.mean_width}


def loop_pair(result: TraceResult) -> LoopPair | None:
    """The loops of a trace that is one slow excursion with both signals measured, or `None`."""
    trace = result.trace
    if trace.x_d is None or trace.p_act is None:
        return None
    pair = measured_pair(result)
    measured = find_loop(trace.on_one_clock().time, pair["x_d"], pair["p_act"])
    simulated = find_loop(trace.time, result.simulated["x_d"], result.simulated["p_act"])
    if measured is None or simulated is None:
        return None
    turbine = 0.0 if trace.p_trb is None else float(np.mean(trace.p_trb))
    return LoopPair(result, turbine, measured, simulated)


def loops_figure(pairs: Sequence[LoopPair]) -> go.Figure:
    """All slow loops in one picture, a colour for every turbine pressure; points are measured, lines simulated."""
    figure = go.Figure()
    for number, pair in enumerate(pairs):
        color = PALETTE[number % len(PALETTE)]
        at = f"{pair.turbine / 100:.0f} mbar at the turbine"
        loops = loop_curves(pair.result, POINTS)
        figure.add_trace(points(*loops["measured"], f"{at}, measured", color, 3, opacity=0.3))
        figure.add_trace(curve(*loops["simulated"], f"{at}, simulated", color, width=1.6))
    return styled(figure, 520, LABEL["p_act"], LABEL["x_d"], hovermode="closest")
