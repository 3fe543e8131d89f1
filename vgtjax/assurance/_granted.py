"""What a fit takes for granted, gains of sensors and values that are held with a tolerance: how the signals change
where one of these is off by its standard uncertainty."""

import numpy as np
from jaxtyping import Float

from ..estimation import CHANNELS, Task


def gains(task: Task) -> list[str]:
    """Channels that are fitted and whose gain is known with an uncertainty only."""
    return [channel for channel in task.gains if channel in task.channels]


def by_gains(
    task: Task, observed: Float[np.ndarray, "*samples channel"]
) -> Float[np.ndarray, "*samples channel gains"]:
    """Changes of what is observed, in its units, by [`gains`][]."""
    parts = np.array([task.gains[channel] for channel in gains(task)])
    only = np.array([[name == channel for channel in gains(task)] for name in CHANNELS], float)
    return np.asarray(observed)[..., None] * only * parts


def tolerances(task: Task) -> Float[np.ndarray, " held"]:
    """Standard uncertainties of what is held, in the units of the table, in the order of `task.tolerances`."""
    return np.array(list(task.tolerances.values()))
