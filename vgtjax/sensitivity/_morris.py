"""Elementary effects: how much an output moves when one input alone is moved, from many starting points."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._moments import Result, Weights, reciprocal, weighted_mean, weights_or_equal

SHORTEST = 0.01
"""Part of an input's range; a shorter step is left out, because it divides the error of a simulation by next to nothing
and makes one base point outweigh all others. That is one step in fifty."""


@dataclasses.dataclass(frozen=True, eq=False)
class ElementaryEffects:
    """Statistics of elementary effects, each `(*replicates, outputs, inputs)`.

    In units of the output over the whole unit interval of an input: `mu` their mean, `mu_star` the mean of their
    sizes, `sigma` their standard deviation, which curvature and interactions cause.
    """

    mu: Result
    mu_star: Result
    sigma: Result


def elementary_effects(
    u_a: Float[np.ndarray, "base inputs"],
    u_b: Float[np.ndarray, "base inputs"],
    a: Float[np.ndarray, "base outputs"],
    ab: Float[np.ndarray, "base inputs outputs"],
    weights: Weights | None = None,
) -> ElementaryEffects:
    """Elementary effects of radial steps (Morris, 1991; Campolongo, Saltelli and Cariboni, 2011).

    Steps shorter than `SHORTEST` are left out; an input that has fewer than two others gets NaN.

    **Arguments:** `u_a`, `u_b`: the points A and B in the unit cube; `a`, `ab`: the outputs at A and AB; `weights` of
    the base points, equal by default.
    """
    weights = weights_or_equal(weights, len(a))
    step = u_b - u_a
    used = np.abs(step) >= SHORTEST
    inverse = np.where(used, 1.0 / np.where(used, step, 1.0), 0.0)
    effects = (ab - a[:, None, :]) * inverse[:, :, None]  # zero where the step is too short
    count = np.sum(used, axis=0)
    share = np.where(count > 1, weighted_mean(weights, used.astype(float)), 0.0)
    norm = reciprocal(share, np.nan)[..., None]
    centre = np.sum(effects, axis=0) / np.maximum(count, 1)[:, None]
    apart = np.where(used[:, :, None], effects - centre, 0.0)
    mean = weighted_mean(weights, apart) * norm
    spread = np.maximum(weighted_mean(weights, apart**2) * norm - mean**2, 0.0)
    unbiased = (count / np.maximum(count - 1, 1))[:, None]
    size = weighted_mean(weights, np.abs(effects)) * norm
    return ElementaryEffects(*(np.swapaxes(part, -1, -2) for part in (mean + centre, size, np.sqrt(spread * unbiased))))
