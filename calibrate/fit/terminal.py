"""What a fit says last in the terminal: how each trace is met, every parameter with its interval, and one sentence."""

from collections.abc import Sequence

import rich.box
import rich.table

from vgtjax.estimation import Calibration, traces_met
from vgtjax.traces import SIGNALS

from ..study.parameter_file import Entry
from .outcome import Fitted


def last_words(fitted: Fitted, entries: Sequence[Entry]) -> list[rich.table.Table | str]:
    """Tables of traces and free parameters, and the verdict."""
    free = [entry for entry in entries if entry.free]
    return [_traces(fitted.calibration), _parameters(free), f"verdict: {verdict(fitted, entries)}"]


def _traces(calibration: Calibration) -> rich.table.Table:
    table = _table("trace", "use")
    for channel in calibration.task.channels:
        unit = SIGNALS[channel].unit.split()[0]  # a difference of pressures is not absolute
        table.add_column(f"RMSE of {channel}, {unit}", justify="right")
        table.add_column("noise", justify="right")
    for result in calibration.traces:
        cells = []
        for channel in calibration.task.channels:
            met = result.channels.get(channel)
            cells += ["", ""] if met is None else [f"{met.rmse:.3g}", f"{met.noise:.3g}"]
        table.add_row(result.trace.name, result.use, *cells)
    return table


def _parameters(entries: Sequence[Entry]) -> rich.table.Table:
    table = _table("parameter")
    for name in ("value", "std. error", "95 % interval", "unit", ""):
        table.add_column(name, justify="left" if name in ("unit", "") else "right")
    for entry in entries:
        error = "" if entry.std_error is None else f"{entry.std_error:.2g}"
        remark = "at bound" if entry.at_bound else "" if entry.identifiable else "not determined"
        table.add_row(entry.name, f"{entry.value:.6g}", error, _interval(entry), entry.unit, remark)
    return table


def _interval(entry: Entry) -> str:
    if entry.interval is None:
        return ""
    low, high = ("..." if end is None else f"{end:.5g}" for end in entry.interval)
    return f"{low} to {high}"


def _table(*columns: str) -> rich.table.Table:
    table = rich.table.Table(box=rich.box.SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        table.add_column(column, no_wrap=True)
    return table


def verdict(fitted: Fitted, entries: Sequence[Entry]) -> str:
    """One sentence: whether the values may be used, which ones, and how well the traces are met."""
    calibration = fitted.calibration
    if not fitted.certificate.passed:
        return f"NOT to be used: {fitted.certificate.sentence}"
    if not calibration.converged:
        return f"NOT converged, so no value may be used: {calibration.verdict}"
    free = [entry for entry in entries if entry.free]
    unknown = [entry.name for entry in free if not entry.identifiable]
    said = f"converged; {len(free) - len(unknown)} of {len(free)} free parameters are determined"
    if unknown:
        said += f" (not {', '.join(unknown)})"
    return f"{said}; {traces_met(calibration)}"
