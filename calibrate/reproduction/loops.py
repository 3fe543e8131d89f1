"""Statements on hysteresis under exhaust gas [3.16, 3.17, section 3.6, section 4.2]."""

import functools

import numpy as np

import vgtjax
from vgtjax.experiments import HysteresisLoop
from vgtjax.identification import identify_vane_map
from vgtjax.parts import OPERATING_POINTS

from ..study.read import EXAMPLE
from . import experiments
from .rows import Found, Kind, Rising, Row


@functools.cache
def example_traces() -> tuple[vgtjax.Trace, ...]:
    """Slow loops of an actuator of the fleet, simulated by an independent plant, at each of `OPERATING_POINTS`."""
    folder = EXAMPLE.parent / "loops"
    return tuple(vgtjax.load_trace(path) for path in sorted(folder.glob("*.csv")))


@functools.cache
def borrowed_map() -> vgtjax.HysteresisMap:
    """Vane force identified from those loops [3.16]; the thesis's own tables are pictures."""
    blank = vgtjax.HysteresisMap()
    found = identify_vane_map(vgtjax.Actuator(vane_force=blank), example_traces())
    tables = {name: found.values[f"vane_force.{name}"] for name in ("closing", "opening")}
    return vgtjax.replace_parameters(blank, tables)


@functools.cache
def runs() -> dict[float, vgtjax.Solution]:
    """The printed actuator with that vane force, closed and opened slowly at each turbine pressure."""
    model = experiments.mechanical(vane_force=borrowed_map())
    return {pressure: experiments.pressure_ramp(model, experiments.TOP, pressure) for pressure in OPERATING_POINTS}


def _loops() -> list[HysteresisLoop]:
    return [experiments.loop_of(run) for run in runs().values()]


def _mbar(pascal: float) -> float:
    return float(pascal) / experiments.MBAR


def _widths() -> Found:
    """Mean widths in mbar: the printed actuator's with the borrowed force, and those of the example's traces."""
    own = [experiments.loop_of(trace) for trace in example_traces()]
    facts = {"own": ", ".join(f"{_mbar(loop.mean_width):.1f}" for loop in own)}
    return Found(tuple(_mbar(loop.mean_width) for loop in _loops()), facts)


def _width_along() -> Found:
    """Width at 1500 mbar near the open end, in the middle and near the closed end of the span."""
    width = _loops()[1].width
    return Found(tuple(_mbar(width[at]) for at in (0, len(width) // 2, -1)))


def _closing_pressures() -> Found:
    return Found(tuple(_mbar(experiments.closing_pressure(run)) for run in runs().values()))


def _friction_width() -> Found:
    """`2 F_c / A_d` in mbar."""
    friction, area = vgtjax.LuGre(), float(experiments.actuator().diaphragm.area)
    static = 2 * float(friction.static_force) / area
    found = 2 * float(friction.coulomb_force) / area
    return Found(_mbar(found), {"static": f"{_mbar(static):.1f}", "simulated": f"{_mbar(_loops()[0].mean_width):.1f}"})


def _more_when_closed() -> Found:
    """Force while closing near the open stop and near the closed one, at 1500 mbar."""
    table = np.asarray(borrowed_map().closing).reshape(2, -1)[0]
    return Found((float(table[-1]), float(table[0])))


def _open_and_closed() -> Found:
    """Mean size of the force at 3000 mbar while closing and while opening."""
    closing, opening = (
        np.asarray(table).reshape(2, -1)[1] for table in (borrowed_map().closing, borrowed_map().opening)
    )
    sizes = float(np.abs(closing).mean()), float(np.abs(opening).mean())
    return Found(sizes, {"more": "closing" if sizes[0] > sizes[1] else "opening"})


_row = functools.partial(Row, section="3.6 Complete model validation: loops")
_TABLES = "the force tables other than as pictures (Figures 3.10 to 3.12)"
_BORROWED = "With tables identified from loops that an independent plant simulated this {meets} the statement."

ROWS = (
    _row(
        id="loop-friction",
        kind=Kind.RESULT,
        quantity="width of the loop at 0 mbar by Coulomb friction, 2 F_c/A_d",
        where="(2.34), Table B.2, Figures 3.2, 4.5",
        printed="a curve",
        unit="mbar",
        rule=None,
        ours=_friction_width,
        reason="With F_s in the place of F_c it is {static} mbar, simulated {simulated} mbar.",
        missing="the loop other than as a picture",
    ),
    _row(
        id="loop-wider",
        kind=Kind.OWN_INPUTS,
        quantity="mean width at 0, 1500 and 3000 mbar",
        where="section 3.6, Figures 3.6, 3.23, 3.24; section 4.2",
        printed="wider with turbine pressure",
        unit="mbar",
        rule=Rising(1.0),
        ours=_widths,
        reason=_BORROWED + " Those loops themselves are {own} mbar wide.",
        missing=_TABLES,
    ),
    _row(
        id="loop-closing-pressure",
        kind=Kind.OWN_INPUTS,
        quantity="pressure that closes the vanes at 0, 1500 and 3000 mbar",
        where="section 3.6, Figure 3.24; section 4.2, Figures 4.6, 4.7",
        printed="grows with turbine pressure; the saturation point shifts",
        unit="mbar",
        rule=Rising(1.0),
        ours=_closing_pressures,
        reason=_BORROWED,
        missing=_TABLES,
    ),
    _row(
        id="loop-towards-closed",
        kind=Kind.OWN_INPUTS,
        quantity="width at 1500 mbar at 2, 5 and 8 mm",
        where="section 3.6, Figure 3.23",
        printed="grows towards the closed position",
        unit="mbar",
        rule=Rising(0.1),
        ours=_width_along,
        reason=_BORROWED,
        missing=_TABLES,
    ),
    _row(
        id="force-towards-closed",
        kind=Kind.OWN_INPUTS,
        quantity="force while closing at 1500 mbar, vanes open and vanes closed",
        where="section 3.4.2, Figure 3.10",
        printed="more influential with the vanes closed",
        unit="N",
        rule=Rising(0.1),
        ours=_more_when_closed,
        reason="In the tables of such loops this {meets} the statement.",
        missing=_TABLES,
    ),
    _row(
        id="force-open-and-closed",
        kind=Kind.OWN_INPUTS,
        quantity="mean force at 3000 mbar while closing and while opening",
        where="section 3.4.2; section 4.2, Figures 4.8, 4.9",
        printed="3.4.2: more while closing; 4.2: more while opening",
        unit="N",
        rule=None,
        ours=_open_and_closed,
        reason="The two sections contradict each other; in the tables of such loops it is more while {more}.",
        missing=_TABLES,
    ),
)
