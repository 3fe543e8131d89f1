"""The report of a tolerance study: one HTML file that carries all it shows."""

from typing import Any

import scipy.special

from vgtjax.experiments import SlowLoop, StepResponse, label
from vgtjax.population import Results

from ..output.page import figure_html, render_page
from ..population import ChunkStore, PopulationJob, scaled
from . import figures

SHOWN_FAILURES = 10


def render(job: PopulationJob, store: ChunkStore, known: Results, summary: dict[str, Any]) -> str:
    """The report as HTML."""
    return render_page(
        "tolerance.html.jinja",
        **job.heading(),
        summary=summary,
        failed=[
            (each["sample"], each["cause"].replace("_", " "), _unusual(job, each["values"]))
            for each in summary["failed"]["samples"][:SHOWN_FAILURES]
        ],
        loops=_loops(job, store),
        effects=_effects(job, store),
        histograms=_histograms(job, store),
        steps=_steps(job, store, known),
        units=_units(job, summary),
    )


def _unusual(job: PopulationJob, values: dict[str, float]) -> list[tuple[str, float, float]]:
    """The quantities of a sample that lie farthest out, with their normal scores."""
    scores = [
        (entry, values[entry], float(scipy.special.ndtri(margin.cdf(values[entry]))))
        for entry, margin in _margins(job)
        if values[entry] is not None
    ]
    return sorted(scores, key=lambda score: -abs(score[2]))[:4]


def _margins(job: PopulationJob) -> list[tuple[str, Any]]:
    return list(zip(job.population.factors.entries, job.population.margins, strict=True))


def _slow_loop(job: PopulationJob) -> SlowLoop:
    return next(each for each in job.experiments if isinstance(each, SlowLoop))


def _loops(job: PopulationJob, store: ChunkStore) -> list[dict[str, str]]:
    sections = []
    for pressure in _slow_loop(job).turbine_pressures:
        branches = {way: store[f"{way}_pressure_{label(pressure)}"] / 100 for way in ("closing", "opening")}
        figure = figures.loop_figure(pressure, branches, job.measured)
        sections.append({"title": f"{pressure / 100:.0f} mbar at the turbine inlet", "figure": figure_html(figure)})
    return sections


def _effects(job: PopulationJob, store: ChunkStore) -> list[dict[str, str]]:
    pressures = list(_slow_loop(job).turbine_pressures)
    if len(pressures) < 2:
        return []
    sections = []
    for direction, title in (("open", "Opening vanes [Fig. 4.8]"), ("closed", "Closing vanes [Fig. 4.9]")):
        names = [each.name for each in store.numbers if each.name.startswith(f"{direction}_vane_effect")]
        simulated = {name: store[name] / 100 for name in names}
        figure = figures.effect_figure(direction, simulated, pressures, job.measured)
        sections.append({"title": title, "figure": figure_html(figure)})
    return sections


def _histograms(job: PopulationJob, store: ChunkStore) -> list[str]:
    """Of every output with a limit, and of the loop widths."""
    limits = job.study.tolerance.limits
    shown = []
    for output in store.numbers:
        if output.name in limits or output.name.startswith("hysteresis_"):
            measured = [
                float(loops.readings[output.name]) * scaled(output).factor
                for loops in job.measured.values()
                if output.name in loops.readings
            ]
            values = store[output.name] * scaled(output).factor
            shown.append(figure_html(figures.histogram(output, values, limits.get(output.name), measured)))
    return shown


def _steps(job: PopulationJob, store: ChunkStore, known: Results) -> list[dict[str, str]]:
    sections = []
    for experiment in job.experiments:
        for output in experiment.outputs if isinstance(experiment, StepResponse) else ():
            if output.axis and output.unit == "m":
                factor = scaled(output).factor
                figure = figures.step_figure(output, store[output.name] * factor, known[output.name][0] * factor)
                sections.append({"title": output.meaning, "figure": figure_html(figure)})
    return sections


def _units(job: PopulationJob, summary: dict[str, Any]) -> dict[str, Any] | None:
    """Measured widths beside those that the unit's own fitted model gives."""
    if not summary["units"]:
        return None
    pressures = sorted({float(at) for unit in summary["units"].values() for at in unit["hysteresis_mbar"]})
    rows = []
    for name, unit in summary["units"].items():
        simulated = summary["simulated_units"].get(name, {})
        cells = [(unit["hysteresis_mbar"].get(f"{at:g}"), simulated.get(f"hysteresis_{at:g}mbar")) for at in pressures]
        rows.append({"name": name, "cells": cells})
    return {"pressures": [f"{at:g}" for at in pressures], "rows": rows, "fitted": bool(summary["simulated_units"])}
