"""The report of a fit: one HTML file that carries all it shows."""

import collections
from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from vgtjax.estimation import REACHED, Calibration
from vgtjax.parameters import parameter_table, table_row

from ..output import figures
from ..output.page import render_page
from ..output.sections import model_sections
from ..resumable import Summaries
from ..study.models import passivity_note, taken_for_exact
from ..study.parameter_file import Entry, by_entry, start_as_study
from ..study.units import Job, Unit
from .around import slices_figure
from .budget import budget_rows
from .decisions import decisions
from .outcome import Fitted
from .posterior import rows
from .terminal import verdict

COLOURED = 1.5
"""Errors by windows over those by the noise as it was found, from which that deserves a word."""


def render(job: Job, unit: Unit, fitted: Fitted, table: list[Entry]) -> str:
    """The report of one unit as HTML, with plots, their library and the study inside."""
    calibration, around = fitted.calibration, fitted.around
    known = calibration.uncertainty.determined
    entries = [e for e, is_known in zip(calibration.task.selection.entries, known, strict=True) if is_known]
    covariance = calibration.covariance[np.ix_(known, known)]
    cost, sources = 2 * np.asarray(calibration.progress.history), list(calibration.budget.moved)
    return render_page(
        "fit.html.jinja",
        **job.heading(unit.name),
        hashes=unit.hashes,
        fit=calibration,
        certificate=fitted.certificate,
        seconds=fitted.seconds,
        undetermined=fitted.undetermined,
        sentence=verdict(fitted, table),
        before=fitted.known_before,
        table=table,
        start=start_as_study(calibration),
        besides=[*found_besides(calibration), *taken_for_exact(calibration.task)],
        budget=budget_rows(calibration),
        sources=sources,
        parts=[
            "value of",
            "A: noise",
            "A: scatter",
            *(f"B: {source}" for source in sources),
            "combined",
            "unit",
            "noise by windows",
        ],
        decisions=decisions(fitted, table),
        shifts=dict(zip(calibration.task.selection.entries, calibration.shifts.tolist(), strict=True)),
        passivity=passivity_note(calibration.model),
        **model_sections(calibration.model, calibration.traces),
        convergence=figures.convergence_figure(cost, "chi^2 / N"),
        autocorrelation=figures.autocorrelation_figure(calibration.traces),
        waterfall=waterfall_figure(calibration.progress.waterfall) if calibration.progress.waterfall else None,
        around=around,
        posterior=fitted.posterior,
        posterior_rows=[] if fitted.posterior is None else rows(fitted.posterior, calibration),
        slices=None if around is None else slices_figure(around.slices),
        correlation=figures.correlation_figure(entries, covariance) if len(entries) > 1 else None,
    )


def starts_sentence(calibration: Calibration) -> str:
    """How many of the starts have found the best end; those within one of chi^2 are the same."""
    waterfall, count = calibration.progress.waterfall, calibration.count
    costs = [cost for cost, _, status in waterfall if status in REACHED and cost is not None]
    same = sum(2 * count * (cost - min(costs)) < 1 for cost in costs)
    statuses = collections.Counter(status.partition(":")[0] for _, _, status in waterfall)
    ends = ", ".join(f"{number} {status}" for status, number in statuses.items())
    failed = [f"; start {number} {said}" for number, (_, _, said) in enumerate(waterfall) if said.startswith("failed")]
    return f"{same} of {len(waterfall)} starts end at the same optimum ({ends}){''.join(failed)}"


def waterfall_figure(waterfall: Sequence[tuple[float | None, int, str]]) -> go.Figure:
    """The cost at the end of every start, the least first."""
    ranked = sorted((2 * cost, status) for cost, _, status in waterfall if cost is not None)
    figure, colors = go.Figure(), dict.fromkeys(REACHED, figures.SIMULATED)
    colors |= {"hopeless": figures.MEASURED, "stuck": figures.DUTY}
    for status, color in colors.items():
        places = [(place, chi2) for place, (chi2, said) in enumerate(ranked, 1) if said == status]
        if places:
            x, y = np.transpose(places)
            figure.add_trace(figures.points(x, y, status, color, 7))
    figures.styled(figure, 320, "start, by its end", "chi^2 / N", hovermode="closest")
    return figure.update_yaxes(type="log", exponentformat="power")


EARLY = 3.0
"""Standard errors from which a duty that comes before its record says so is a fault: as evident as a late one."""


def delay_found(delay: float, error: float) -> str:
    """A sentence on a delay of the duty and its standard error, both in ms."""
    way = "later" if delay > 0 else "earlier"
    known = f" +- {error:.3f} ms {way}" if np.isfinite(error) else f" ms {way} (not determined by these traces)"
    said = f"the duty reaches the valve {abs(delay):.3f}{known} than the traces say"
    if not delay < -EARLY * error:  # also where the error is none
        return said
    why = "which none does unless its clock is another: if it is not, values may be off by more than their errors"
    return f"{said}, {why}"


def found_besides(calibration: Calibration) -> list[str]:
    """A sentence on each thing that a fit found out besides the parameters."""
    progress, sentences = calibration.progress, []
    if progress.waterfall:
        sentences.append(starts_sentence(calibration))
    if progress.finer:
        sentences.append("derivatives failed with longer steps along slow traces; the search went on with shorter ones")
    linear = [
        result.trace.name
        for result in calibration.traces
        if calibration.duty_hold(result.trace) == "linear" != result.trace.duty_hold
    ]
    if linear:
        names = ", ".join(linear)
        sentences.append(
            f"the duty of {names} was linear between samples: held, it would have to reach the valve early"
        )
    if progress.otherwise:
        sentences.append(
            "whether the duty was held or linear between samples these slow traces cannot tell: they were fitted both "
            "ways, and how far values differ is part of their errors; state duty_hold of the traces if it is known"
        )
    if calibration.duty_delay_error is not None:
        sentences.append(delay_found(1e3 * calibration.duty_delay, 1e3 * calibration.duty_delay_error))
    sentences += _edges_found(calibration) + _inputs_found(calibration)
    for entry, (value, error) in calibration.instruments.items():
        kind, _, channel = entry.partition(".")
        if kind == "initial":
            continue
        unit = "" if kind == "gain" else f" {table_row(parameter_table(calibration.task.model), entry).unit}"
        known = f"{value:.6g} +- {error:.2g}{unit}" if np.isfinite(error) else "not determined by these traces"
        sentences.append(f"the {kind} of the sensor of {channel} is {known}")
    if any(result.trace.start_number for result in calibration.traces):
        sentences.append(_starts_found(calibration))
    for name, text in (("x_d", "position"), ("p_act", "chamber pressure")):
        sensors = [known[name] for known in calibration.sensors if name in known]
        coloured = sum(len(sensor.memory) > 0 for sensor in sensors)
        if coloured:
            sentences.append(f"the noise of the {text} is coloured in {coloured} of {len(sensors)} traces")
        far = sum(round(sensor.outliers * len(sensor.trust)) for sensor in sensors)
        if far:
            sentences.append(f"{far} samples of the {text} are outliers and count for little")
    if calibration.budget.excess > COLOURED:
        sentences.append(
            f"residuals are correlated beyond what was found of the sensors' noise: by sums over "
            f"{calibration.budget.window:.2g} s errors are {calibration.budget.excess:.2g} times as large in the median"
        )
    if progress.corrections:
        largest = float(np.nanmax(np.abs(calibration.shifts), initial=0.0))
        state = "settled" if progress.settled else "did not settle, and their scatter is part of the errors"
        sentences.append(
            f"corrections for sensors and numerical errors moved values by at most {largest:.1f} standard errors, and "
            f"{state}"
        )
    elif calibration.task.unknown.anything:
        sentences.append(
            "no corrections were made for sensors and numerical errors, because the search did not converge, values "
            "ran away, or a simulation failed; errors don't count them"
        )
    return sentences


def _edges_found(calibration: Calibration) -> list[str]:
    """Where the edges of duties were, if that is not where their records have them."""
    late = [late for result in calibration.traces for late in calibration.late_edges(result.trace)]
    if not late:
        return []
    beside = " beside that delay" if calibration.duty_delay else ""
    return [
        f"the duty of the traces that were fitted jumps between its samples: its {len(late)} edges were between "
        f"{_beside_record(min(late))} and {_beside_record(max(late))} than recorded{beside}; that their times are not "
        "known is part of all errors, and other traces are read without that"
    ]


def _beside_record(late: float) -> str:
    return f"{1e3 * abs(late):.2f} ms {'later' if late > 0 else 'earlier'}"


def _inputs_found(calibration: Calibration) -> list[str]:
    """How a measured pressure was read that drives the rod."""
    sensors = [
        sensor for result in calibration.traces if (sensor := calibration.input_sensor(result.trace)) is not None
    ]
    if not sensors:
        return []
    resting = [sensor for sensor in sensors if sensor.offset_error]
    noise = max(sensor.noise for sensor in sensors)
    farthest = max((sensor.offset for sensor in resting), key=abs, default=0.0)
    offsets = f", and less what it shows at rest in {len(resting)} of {len(sensors)} traces ({farthest:.3g} Pa at most)"
    return [
        f"the pressure that drives the rod is read without the noise of its sensor, {noise:.3g} Pa"
        f"{offsets if resting else ''}; what that leaves open is part of all errors, and simulate reads it as it is "
        "recorded"
    ]


def _starts_found(calibration: Calibration) -> str:
    """How far from the beginnings of their signals traces start whose start states were free."""
    names = [result.trace.name for result in calibration.traces if result.trace.start_number]
    farthest: dict[str, tuple[float, float]] = {}
    for entry, (value, error) in calibration.instruments.items():
        state = entry.partition("[")[0]
        if np.isfinite(error) and abs(value) >= abs(farthest.get(state, (0.0, 0.0))[0]):
            farthest[state] = value, error
    units = {"initial.x_d": (1e6, "um"), "initial.p_act": (1.0, "Pa"), "initial.T_act": (1.0, "K")}
    found = [
        f"{scale * farthest[state][0]:.3g} +- {scale * farthest[state][1]:.2g} {unit}"
        for state, (scale, unit) in units.items()
        if state in farthest
    ]
    far = f": at most {', '.join(found)} from the signals' beginnings and the air's temperature" if found else ""
    return f"the start states of {', '.join(names)} were free{far}"


def render_overview(job: Job, summaries: Summaries, population: dict[str, dict[str, Any]]) -> str:
    """The report of a study with several units: how each was met, how they differ, and links to their own reports.

    `population` has the parameters of `parameters.json` by unit.
    """
    return render_page(
        "fit_overview.html.jinja",
        **job.heading(),
        units=[_overview_row(str(name), summary) for name, summary in summaries.items()],
        parameters=_spread(population),
    )


def _overview_row(name: str, summary: dict[str, Any]) -> dict[str, Any]:
    """One unit in a line: its worst trace counts."""
    traces = summary["traces"].values()
    widths = [trace["loop_width"] for trace in traces if "loop_width" in trace]

    def worst(channel: str, scale: float) -> float | None:
        found = [trace["rmse"][channel] * scale for trace in traces if trace["rmse"].get(channel) is not None]
        return max(found, default=None)

    return {
        "name": name,
        "summary": summary,
        "x_d": worst("x_d", 1e6),
        "p_act": worst("p_act", 1.0),
        "loop": max((100 * abs(width["simulated"] / width["measured"] - 1) for width in widths), default=None),
        "widths": [width["measured"] / 100 for width in widths],
    }


def _spread(population: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """How each fitted entry differs from unit to unit, beside the standard error of one unit."""
    found: dict[str, list[tuple[float, float | None, str]]] = {}
    for parameters in population.values():
        for name, fields in parameters.items():
            columns = [by_entry({name: fields[key]}) for key in ("value", "std_error", "unit", "free")]
            for entry in columns[0]:
                value, error, unit, free = (column[entry] for column in columns)
                if free and value is not None:
                    found.setdefault(entry, []).append((value, error, unit))
    return [_spread_row(entry, numbers) for entry, numbers in found.items()]


def _spread_row(entry: str, found: list[tuple[float, float | None, str]]) -> dict[str, Any]:
    values = np.array([value for value, _, _ in found])
    errors = [error for _, error, _ in found if error is not None]
    return {
        "entry": entry,
        "unit": found[0][2],
        "mean": float(values.mean()),
        "deviation": float(values.std(ddof=1)) if len(values) > 1 else None,
        "low": float(values.min()),
        "high": float(values.max()),
        "error": float(np.median(errors)) if errors else None,
    }
