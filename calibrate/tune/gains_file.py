"""`gains.json`: tuned gains in the form of `parameters.json`."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from vgtjax.tuning import gain_names

from ..study.parameter_file import Entry, Estimate, tabulate, to_json
from .job import TuneJob


def gain_entries(job: TuneJob, coordinates: np.ndarray) -> list[Entry]:
    """Every gain of the design, free and fixed, beside its start; one that moves no error is not identifiable."""
    start, tuned = job.true.controller, job.true.controller_at(coordinates)
    at_bound = job.true.transform.at_bound(jnp.asarray(coordinates)).tolist()
    # A short memory: derivatives of a longer one may overflow.
    bends = job.smooth.linearise(coordinates, min(job.smooth.memories)).curvatures.sum(0)
    felt = (np.diag(bends) > 0).tolist()
    found = zip(job.true.selection.entries, at_bound, felt, strict=True)
    return tabulate(
        start, tuned, {name: Estimate(math.nan, *flags) for name, *flags in found}, job.bounds, gain_names(start)
    )


def gains_json(job: TuneJob, entries: list[Entry]) -> dict[str, Any]:
    """The content of `gains.json`; a gain that was chosen has no standard error."""
    return {"design": job.study.control.design, **to_json(job.study, entries)}
