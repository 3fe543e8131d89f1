"""`summary.json` of a tolerance study: quantiles, yield, envelopes, failures, and the measured units beside them."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.stats

from vgtjax.experiments import MeasuredLoops, Output, label
from vgtjax.parameters import unknown_name
from vgtjax.sensitivity import Sample

from ..population import ChunkStore, PopulationJob, describe_failed, describe_quantities, finite, scaled
from ..study.tables import Limit
from .samples import curve_rows

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
ENVELOPE = (0.05, 0.5, 0.95)
CONFIDENCE = 0.95

Readings = dict[str, float]


@dataclasses.dataclass(frozen=True, eq=False)
class Known:
    """The readings of actuators that are no samples, by column: the nominal one, and fitted units."""

    nominal: Readings
    units: dict[str, Readings]


def check_limits(outputs: Sequence[Output], limits: dict[str, Limit]) -> None:
    """Whether limits are on numbers that the experiments give.

    **Raises:** `InputError` for the first that is not, with the nearest name.
    """
    known = [output.name for output in outputs if not output.axis]
    for name in limits:
        if name not in known:
            raise unknown_name("[tolerance.limits]", name, known)


def summarise(
    job: PopulationJob,
    sample: Sample,
    store: ChunkStore,
    known: Known,
    outputs: tuple[Output, ...],
    seconds: float,
) -> dict[str, Any]:
    """The whole summary."""
    table, failed = job.study.tolerance, store.failed()
    good = np.ones(store.rows, bool)
    good[failed] = False
    found: dict[str, Any] = {}
    meets_all = good.copy()
    for output in outputs:
        if not output.axis:
            values = store.column(output.name) * scaled(output).factor
            limit = table.limits.get(output.name)
            found[output.name] = _number(output, values[good], known.nominal[output.name], limit)
            if limit is not None:
                meets_all &= _meets(values, limit)
    return {
        "samples": store.rows,
        "failed": {"count": len(failed), "samples": describe_failed(job, sample, failed)},
        "yield": _share(meets_all[good]) if table.limits else None,
        "outputs": found,
        "envelopes": {output.name: _envelope(store, output) for output in outputs if output.axis},
        "quantities": describe_quantities(job),
        "notes": list(job.notes),
        "units": {name: _unit(loops) for name, loops in job.measured.items()},
        "simulated_units": {name: _shown(readings, outputs) for name, readings in known.units.items()},
        "sampler": table.sampler,
        "seed": table.seed,
        "precision": table.precision,
        "wall_seconds": round(seconds, 3),
        "study_sha256": job.fingerprint,
    }


def _number(output: Output, values: np.ndarray, nominal: float, limit: Limit | None) -> dict[str, Any]:
    """One output over the samples whose simulation did not fail."""
    defined = values[np.isfinite(values)]
    quantiles = np.quantile(defined, QUANTILES) if len(defined) else np.full(len(QUANTILES), math.nan)
    return {
        "unit": scaled(output).unit,
        "meaning": output.meaning,
        "nominal": finite(nominal * scaled(output).factor),
        "defined": len(defined),
        "mean": finite(defined.mean()) if len(defined) else None,
        "deviation": finite(defined.std(ddof=1)) if len(defined) > 1 else None,
        "quantiles": {f"{share:g}": finite(value) for share, value in zip(QUANTILES, quantiles, strict=True)},
        **({} if limit is None else {"limit": limit.model_dump(), "yield": _share(_meets(values, limit))}),
    }


def _envelope(store: ChunkStore, output: Output) -> dict[str, Any]:
    """Quantiles of a curve at each of its points."""
    shown = scaled(output)
    return {
        "unit": shown.unit,
        "meaning": output.meaning,
        "axis": (np.array(output.axis) * shown.axis_factor).tolist(),
        "axis_unit": shown.axis_unit,
        "quantiles": {
            f"{share:g}": [finite(value) for value in values]
            for share, values in zip(ENVELOPE, envelope(curve_rows(store, output) * shown.factor), strict=True)
        },
    }


def envelope(values: np.ndarray) -> np.ndarray:
    """Quantiles `ENVELOPE` over samples, `(quantiles, points)`; NaN where no sample has a value."""
    defined = np.where(np.isfinite(values), values, np.nan)
    found = np.full((len(ENVELOPE), values.shape[1]), np.nan)
    some = np.any(np.isfinite(defined), axis=0)
    found[:, some] = np.nanquantile(defined[:, some], ENVELOPE, axis=0)
    return found


def _meets(values: np.ndarray, limit: Limit) -> np.ndarray:
    """Which values keep a limit; one that a response does not have keeps none."""
    low = -math.inf if limit.lower is None else limit.lower
    high = math.inf if limit.upper is None else limit.upper
    return (values >= low) & (values <= high)


def _share(meets: np.ndarray) -> dict[str, float] | None:
    """The part that meets, with the interval of Clopper and Pearson, as if samples were independent."""
    if not len(meets):
        return None
    result = scipy.stats.binomtest(int(meets.sum()), len(meets))
    interval = result.proportion_ci(CONFIDENCE)
    return {"share": float(meets.mean()), "low": float(interval.low), "high": float(interval.high)}


def _unit(loops: MeasuredLoops) -> dict[str, Any]:
    """A measured unit: widths in mbar by turbine pressure in mbar, and all else that was read, in mbar."""
    readings = {name: np.asarray(value) / 100 for name, value in loops.readings.items()}
    return {
        "hysteresis_mbar": {label(at).removesuffix("mbar"): width / 100 for at, width in loops.hysteresis.items()},
        "readings_mbar": {name: finite(value) for name, value in readings.items() if np.ndim(value) == 0},
    }


def _shown(readings: Readings, outputs: tuple[Output, ...]) -> dict[str, float | None]:
    return {output.name: finite(readings[output.name] * scaled(output).factor) for output in outputs if not output.axis}
