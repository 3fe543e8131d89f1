"""`gains.json`: tuned gains in the form of `parameters.json`."""

from typing import Any

import numpy as np

import vgtjax
from vgtjax.parameters import table_row
from vgtjax.tuning import gain_names

from ..parameter_file import Row, to_json
from .job import TuneJob


def gain_rows(job: TuneJob, coordinates: np.ndarray) -> list[Row]:
    """Every gain of the design, free and fixed, beside its start; one that moves no error is not identifiable."""
    start, tuned = job.true.controller, job.true.controller_at(coordinates)
    table, free = vgtjax.parameter_table(start), set(job.true.selection.entries)
    everything = vgtjax.select(start, free=gain_names(start))
    at_bound = dict(zip(job.true.selection.entries, job.true.transform.at_bound(coordinates).tolist(), strict=True))
    values = zip(everything.entries, everything.pack(tuned).tolist(), everything.pack(start).tolist(), strict=True)
    # A short memory: derivatives of a longer one may overflow.
    bends = job.smooth.linearise(coordinates, min(job.smooth.memories)).curvatures.sum(0)
    felt = dict(zip(job.true.selection.entries, (np.diag(bends) > 0).tolist(), strict=True))
    rows = []
    for entry, value, initial in values:
        row = table_row(table, entry)
        lower, upper = job.bounds.get(entry, (None, None))
        rows.append(
            Row(
                entry=entry,
                symbol=row.symbol,
                unit=str(row.unit),
                value=value,
                initial=initial,
                std_error=None,
                free=entry in free,
                lower=lower,
                upper=upper,
                at_bound=bool(at_bound.get(entry, False)),
                identifiable=felt.get(entry, False),
                assumed=row.assumed,
                source=row.source,
            )
        )
    return rows


def gains_json(job: TuneJob, rows: list[Row]) -> dict[str, Any]:
    """The content of `gains.json`; a gain that was chosen has no standard error."""
    return {"design": job.study.control.design, **to_json(job.study, rows)}
