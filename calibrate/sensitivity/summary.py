"""`summary.json` of a sensitivity study: every index of every output, ranked, with intervals, and over time."""

from typing import Any

import numpy as np

from vgtjax.experiments import Output
from vgtjax.sensitivity import BootstrapInterval, Interval, RadialDesign, RankedInput, explain

from ..output.files import finite
from ..population import PopulationJob, describe_failed, describe_quantities, scaled
from .analysis import Analysis

CORRELATED = 0.02
"""Squared correlation of two quantities in a sample that is worth a note."""


def summarise(job: PopulationJob, design: RadialDesign, analysis: Analysis, seconds: float) -> dict[str, Any]:
    """The whole summary."""
    table = job.study.sensitivity
    numbers = [output for output in analysis.outputs if not output.axis]
    return {
        "simulations": analysis.rows,
        "base": table.base,
        "seed": table.seed,
        "confidence": table.confidence,
        "threshold": table.threshold,
        "failed": describe_failed(job, design, analysis.failed),
        "leading": _leading(analysis, table.threshold),
        "outputs": {output.name: _output(analysis, output) for output in numbers},
        "over_time": {o.name: _over_time(analysis, o, table.threshold) for o in analysis.outputs if o.axis},
        "quantities": describe_quantities(job),
        "sample_correlation": analysis.sample_correlation,
        "notes": [*job.notes, *sample_note(analysis)],
        **job.account(seconds),
    }


def sample_note(analysis: Analysis) -> list[str]:
    """A sentence where two quantities are correlated in the sample by chance."""
    if analysis.sample_correlation < CORRELATED:
        return []
    return [
        "two quantities happen to be correlated in this sample (squared correlation "
        f"{analysis.sample_correlation:.2g}), which (4.1) takes for an effect; raise base under [sensitivity]"
    ]


def _leading(analysis: Analysis, threshold: float) -> list[dict[str, Any]]:
    """Quantities by the number of outputs for which they matter, that is, whose total index is above the threshold."""
    found: dict[str, list[str]] = {}
    for ranking in analysis.rankings.outputs:
        for entry in ranking.inputs:
            if entry.total.above(threshold):
                found.setdefault(entry.name, []).append(ranking.output)
    return [
        {"quantity": name, "outputs": outputs} for name, outputs in sorted(found.items(), key=lambda kv: -len(kv[1]))
    ]


def _output(analysis: Analysis, output: Output) -> dict[str, Any]:
    ranking, place = analysis.rankings[output.name], analysis.indices.place(output.name)
    (deviation,) = analysis.deviation[place]
    return {
        "meaning": output.meaning,
        "unit": scaled(output).unit,
        "deviation": finite(deviation * scaled(output).factor),
        "r2": finite(ranking.r2),
        "base_points_used": ranking.used,
        "quantities": [_entry(analysis, output, ranking[name]) for name in ranking],
    }


def _entry(analysis: Analysis, output: Output, entry: RankedInput) -> dict[str, Any]:
    indices, names, factor = analysis.indices, (output.name, entry.name), scaled(output).factor
    (bounds,) = analysis.bound[indices.place(output.name)]
    return {
        "quantity": entry.name,
        "src_thesis": _interval(entry.correlation),
        "src": _estimate(indices.regression[names]),
        "first": _interval(entry.first),
        "total": _interval(entry.total),
        "gradient": finite(entry.local.value),
        "derivative_based": finite(bounds[indices.inputs.index(entry.name)]),
        "morris": {
            "mu_star": _estimate(indices.mu_star[names], factor),
            "mu": finite(indices.mu[names].value * factor),
            "sigma": finite(indices.sigma[names].value * factor),
        },
        "verdict": explain(entry, analysis.rankings[output.name].r2),
    }


def _over_time(analysis: Analysis, output: Output, threshold: float) -> dict[str, Any]:
    """Indices along a step, of the quantities that ever matter."""
    rows = analysis.indices.place(output.name)
    indices = analysis.indices
    kinds = {
        "first": indices.first.value,
        "total": indices.total.value,
        "src_thesis": indices.correlation.value,
        "gradient": analysis.local,
    }
    total = analysis.above_noise(output, indices.total.value)
    ever = np.nan_to_num(total, nan=0.0).max(axis=0) > threshold
    return {
        "meaning": output.meaning,
        "time": list(output.axis),
        "unit": scaled(output).unit,
        "deviation": finite(analysis.deviation[rows] * scaled(output).factor),
        "quantities": {
            name: {kind: finite(analysis.above_noise(output, shares)[:, i]) for kind, shares in kinds.items()}
            for i, name in enumerate(analysis.indices.inputs)
            if ever[i]
        },
    }


def _interval(interval: Interval, factor: float = 1.0) -> dict[str, float | None]:
    return {name: finite(value * factor) for name, value in zip(("value", "low", "high"), interval, strict=True)}


def _estimate(estimate: BootstrapInterval, factor: float = 1.0) -> dict[str, float | None]:
    return _interval(Interval(float(estimate.value), float(estimate.low), float(estimate.high)), factor)
