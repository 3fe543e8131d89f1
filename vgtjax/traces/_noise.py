"""How noisy a sensor is, read off its own signal."""

import numpy as np
from jaxtyping import Float

FLOOR = {"x_d": 1e-7, "p_act": 1.0, "f_vane": 1e-4}
"""m, Pa and N; no sensor on these benches is better, and a noise-free record must not get an infinite weight."""


def noise_level(samples: Float[np.ndarray, " time"], channel: str) -> float:
    """Standard deviation of the white noise on a slowly moving signal, in its unit: the robust scale of third
    differences, no less than the quantisation of the record, `step / sqrt(12)`, or `FLOOR`."""
    if len(samples) < 8:
        return FLOOR[channel]
    scale = np.median(np.abs(np.diff(samples, n=3))) / 0.6744897501960817  # of a standard normal
    steps = np.abs(np.diff(samples))
    steps = steps[steps > 1e-9 * np.max(np.abs(samples))]
    quantum = float(np.min(steps)) if len(steps) else 0.0
    return max(float(scale) / np.sqrt(20.0), quantum / np.sqrt(12.0), FLOOR[channel])
