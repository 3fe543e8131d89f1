"""What a fit takes for granted of sensors: how the signals change where a gain is off by its standard uncertainty."""

import numpy as np
from jaxtyping import Float

from .._task import Task
from ..derivatives import CHANNELS


def uncertain_gains(task: Task) -> dict[str, float]:
    """Standard uncertainties of the gains that are taken for granted, by channel, as parts of the gain: of channels
    that are fitted."""
    return {channel: part for channel, part in task.gains.items() if channel in task.channels}


def by_gains(
    task: Task, observed: Float[np.ndarray, "*samples channel"]
) -> Float[np.ndarray, "*samples channel gains"]:
    """Changes of what is observed, in its units, where one of [`uncertain_gains`][] is too large by its uncertainty."""
    gains = uncertain_gains(task)
    only = np.array([[name == channel for channel in gains] for name in CHANNELS], float)
    return np.asarray(observed)[..., None] * only * np.array(list(gains.values()))
