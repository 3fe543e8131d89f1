"""`summary.json` of a tolerance study: quantiles, yield, envelopes, failures, and the units with traces beside them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vgtjax.experiments import MeasuredLoops, Output, label
from vgtjax.parameters import unknown_name
from vgtjax.population import Limits, Results, describe, keeps, yield_of

from ..output.files import finite
from ..population import ChunkStore, Plan, describe_active, describe_failed, describe_quantities, scaled
from ..study.tables import Limit

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
ENVELOPE = (0.05, 0.5, 0.95)
RULE = "a sample whose simulated value lies within keeps the limit, without a guard band (simple acceptance)"


def check_limits(outputs: Sequence[Output], limits: dict[str, Limit]) -> None:
    """Refuses limits on what the experiments don't give as a number."""
    known = [output.name for output in outputs if not output.axis]
    for name in limits:
        if name not in known:
            raise unknown_name("[tolerance.limits]", name, known)


def summarise(plan: Plan, store: ChunkStore, known: Results, seconds: float) -> dict[str, Any]:
    """The whole summary.

    **Arguments:** `known`: of the nominal actuator, then of each fitted unit.
    """
    job, table, failed = plan.job, plan.job.study.tolerance, store.failed()
    good = np.ones(store.rows, bool)
    good[list(failed)] = False
    found: dict[str, Any] = {}
    meets_all = good.copy()
    for output in store.numbers:
        values, limit = store[output.name] * scaled(output).factor, table.limits.get(output.name)
        found[output.name] = _number(output, values[good], known[output.name][0], limit)
        if limit is not None:
            meets_all &= keeps(values, _ends(limit))
    return {
        "samples": store.rows,
        "failed": describe_failed(job, plan.sample, failed),
        "unphysical": {"count": sum(cause == "unphysical" for cause in failed.values())},
        "active_friction": describe_active(job.population, plan.sample),
        "yield": _share(meets_all[good]) if table.limits else None,
        "outputs": found,
        "envelopes": {output.name: _envelope(output, store[output.name]) for output in store.outputs if output.axis},
        "quantities": describe_quantities(job),
        "notes": list(job.notes),
        "units": {name: _unit(loops) for name, loops in job.measured.items()},
        "simulated_units": {name: _shown(store, known, row) for row, name in enumerate(job.fitted, 1)},
        "sampler": table.sampler,
        "seed": table.seed,
        "precision": table.precision,
        **job.account(seconds),
    }


def _number(output: Output, values: np.ndarray, nominal: float, limit: Limit | None) -> dict[str, Any]:
    """One output over the samples whose simulation did not fail."""
    found = describe(values, QUANTILES)
    return {
        "unit": scaled(output).unit,
        "meaning": output.meaning,
        "nominal": finite(nominal * scaled(output).factor),
        "defined": found.defined,
        "mean": finite(found.mean),
        "deviation": finite(found.deviation),
        "quantiles": {f"{share:g}": finite(value) for share, value in zip(QUANTILES, found.quantiles, strict=True)},
        **(
            {}
            if limit is None
            else {"limit": limit.model_dump(), "rule": RULE, "yield": _share(keeps(values, _ends(limit)))}
        ),
    }


def _envelope(output: Output, curves: np.ndarray) -> dict[str, Any]:
    """Quantiles of a curve at each of its points."""
    shown = scaled(output)
    return {
        "unit": shown.unit,
        "meaning": output.meaning,
        "axis": (np.array(output.axis) * shown.axis_factor).tolist(),
        "axis_unit": shown.axis_unit,
        "quantiles": {
            f"{share:g}": finite(values)
            for share, values in zip(ENVELOPE, envelope(curves * shown.factor), strict=True)
        },
    }


def envelope(values: np.ndarray) -> np.ndarray:
    """Quantiles `ENVELOPE` over samples, `(quantiles, points)`; NaN where no sample has a value."""
    return np.stack([describe(column, ENVELOPE).quantiles for column in values.T], axis=1)


def _ends(limit: Limit) -> Limits:
    return limit.lower, limit.upper


def _share(kept: np.ndarray) -> dict[str, float] | None:
    found = yield_of(kept)
    return None if found is None else found._asdict()


def _unit(loops: MeasuredLoops) -> dict[str, Any]:
    """A unit with traces: widths in mbar by turbine pressure in mbar, and all else that was read, in mbar."""
    readings = {name: np.asarray(value) / 100 for name, value in loops.readings.items()}
    return {
        "hysteresis_mbar": {label(at).removesuffix("mbar"): width / 100 for at, width in loops.hysteresis.items()},
        "readings_mbar": {name: finite(value) for name, value in readings.items() if np.ndim(value) == 0},
    }


def _shown(store: ChunkStore, known: Results, row: int) -> dict[str, float | None]:
    return {output.name: finite(known[output.name][row] * scaled(output).factor) for output in store.numbers}
