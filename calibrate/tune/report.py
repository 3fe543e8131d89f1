"""The report of tuning: one HTML file that carries all it shows."""

from typing import Any

import numpy as np

import vgtjax
from vgtjax.tuning import TuningProblem, wanted_widths

from ..output.page import figure_html, render_page
from ..study.parameter_file import Row
from . import figures
from .job import TuneJob
from .outcome import Comparison, Outcome


def render(job: TuneJob, outcome: Outcome, rows: list[Row], summary: dict[str, Any]) -> str:
    """The report as HTML."""
    return render_page(
        "tune.html.jinja",
        **job.heading(),
        summary=summary,
        rows=rows,
        convergence=figure_html(figures.convergence(outcome.progress)),
        smoothed=_smoothed(job),
        groups=[
            ("Closed loops that gains were tuned on", _table(outcome.true), _spread(outcome.true)),
            ("Closed loops that tuning has not seen", _table(outcome.unseen), _spread(outcome.unseen)),
        ],
        runs=_runs(outcome),
    )


def _spread(comparison: Comparison) -> str:
    return figure_html(figures.spread(comparison))


def _smoothed(job: TuneJob) -> list[tuple[str, float, float]]:
    """What switches or jumps in controller, plant and sensors: its own width, and that while tuning."""

    def widths(problem: TuningProblem) -> dict[str, float]:
        plants: Any = problem.cases.plants
        sensors = problem.cases.scenarios.sensors
        return {
            "lift over which the atmosphere's orifice opens, m": plants.converter.opening_width,
            "step of the position's sensor, m": float(np.max(sensors.position.quantum)),
            "step of the pressure's sensor, Pa": float(np.max(sensors.pressure.quantum)),
            **{
                name: float(vgtjax.get_parameter(problem.controller, name))
                for name in wanted_widths(problem.controller)
            },
        }

    true, smooth = widths(job.true), widths(job.smooth)
    return [(name, true[name], smooth[name]) for name in true]


def _table(comparison: Comparison) -> list[dict[str, Any]]:
    """A row for every reference and turbine pressure: the middle and the worst of the plants."""
    labels = comparison.problem.cases.labels
    keys = dict.fromkeys((label.reference, label.turbine_pressure) for label in labels)
    table = []
    for key in keys:
        mine = [i for i, label in enumerate(labels) if (label.reference, label.turbine_pressure) == key]
        cells: list[dict[str, Any]] = []
        for costs in (comparison.start, comparison.tuned):
            good = [i for i in mine if not costs.failed[i]]
            cells.append(
                {
                    "cost": float(np.mean(costs.costs[good])) if good else None,
                    "median": float(np.median(costs.rms[good])) if good else None,
                    "worst": float(np.max(costs.rms[good])) if good else None,
                    "peak": float(np.max(costs.peak[good])) if good else None,
                    "failed": len(mine) - len(good),
                }
            )
        table.append({"reference": key[0], "turbine_pressure": key[1], "plants": len(mine), "cells": cells})
    return table


def _runs(outcome: Outcome) -> list[dict[str, str]]:
    """The worst closed loop of every reference, seen and unseen."""
    sections = []
    for comparison in (outcome.true, outcome.unseen):
        worst = comparison.worst()
        before = comparison.problem.simulate(comparison.problem.start, worst)
        after = comparison.problem.simulate(outcome.coordinates, worst)
        for place, index in enumerate(worst):
            title = f"{comparison.problem.cases.labels[index]}{' (unseen)' if comparison is outcome.unseen else ''}"
            sections.append({"title": title, "figure": figure_html(figures.run_figure(before, after, place))})
    return sections
