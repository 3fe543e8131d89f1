"""What a study asks of a fit."""

from vgtjax.estimation import Task
from vgtjax.identification import plan_fit

from ..study.units import Job, Unit


def plan(job: Job, unit: Unit) -> Task:
    """The task of one unit.

    **Raises:** `InputError` for mistakes that only show here: nothing free, a start value outside its bounds.
    """
    chosen = job.study.fit
    return plan_fit(
        unit.model,
        unit.used("fit"),
        unit.used("validate"),
        free=chosen.free,
        fixed=chosen.fixed,
        bounds=unit.bounds,
        unknown=unit.unknown(job.study),
        **unit.known._asdict(),
        scales=unit.scales,
        starts=chosen.starts,
        gains=job.study.report.gains,
        offsets=job.study.report.offsets,
    )
