"""What the traces can tell where a fit begins: the same as the command `check` says, before anything is fitted."""

from typing import Any

import numpy as np

from vgtjax import SimulationError
from vgtjax.assurance import NOTHING, Gain, Information, examining, informing, ranking, remedies
from vgtjax.estimation import VAGUE, Calibrator, Computation, Task

from ..output.console import console


def knowing(calibrator: Calibrator) -> Computation[dict[str, Any]]:
    """What is known before a fit, for JSON, as a computation; which run to record next where one is needed.

    **Raises:** `SimulationError` when the traces determine nothing.
    """
    known = yield from informing(calibrator)
    ran_away = bool(np.any(calibrator.away()))  # to where nothing is felt, and is brought back
    gains = yield from _ranked(calibrator.task, known)
    sentences = [*known.sentences, *remedies(known, gains)]
    alone = calibrator.task.starts < 2 and not ran_away
    if not known.tells and alone and not (yield from examining(calibrator.task)).tells:
        raise SimulationError("; ".join([NOTHING, *sentences]))
    return {
        "undetermined": calibrator.not_estimable(),
        **known.summary(),
        "next": [gain.summary() for gain in gains],
        "sentences": sentences,
    }


def _ranked(task: Task, known: Information) -> Computation[list[Gain]]:
    if not any(error > VAGUE for error in known.errors.values()):
        return []
    try:
        return (yield from ranking(task, known))
    except SimulationError:  # at start values, which are not the fit's
        return []


def say(known: dict[str, Any], who: str) -> None:
    """Warns of what the traces can't tell."""
    undetermined = known.get("undetermined", ())
    if undetermined:
        console.print(f"warning: {who}these traces do not determine {', '.join(undetermined)}; hold or excite them")
    for sentence in known.get("sentences", ()):
        console.print(f"check: {who}{sentence}")
