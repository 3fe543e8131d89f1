"""What the position tells of a load observer's state, along a run."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._errors import InputError
from .._design_model import SECANT
from ..controllers import LoadBackstepping
from ..observers import LoadEstimate, transition
from ._loop import ClosedLoop
from ._replay import step_through

KNOWN_BEFOREHAND = (1e-4, 1e-2, 1e3)
"""m, m/s and Pa; position, velocity and pressure that count as one. Load and friction level have deviations."""


def estimates(controller: LoadBackstepping, run: ClosedLoop, period: float) -> LoadEstimate:
    """What the controller estimated at every sample of a run, once more from what it measured, at a period in s."""
    return step_through(
        controller, run.measured, run.reference, period, lambda before, after, *_: after.controller.estimate
    )


@eqx.filter_jit
def observability(
    controller: LoadBackstepping, run: ClosedLoop, samples: int, *, period: float = 1e-3, secant: float = SECANT
) -> Float[Array, "windows 5"]:
    """Singular values of the observability matrix over windows of so many samples, the largest first.

    Columns are scaled by what is known beforehand, rows by the noise of the position: a direction whose singular value
    is above one is told by the samples of its window, one that is below is not; of a rod on its stop none is. The
    manual's page of derivations has them along Signals 1 and 2.

    **Arguments:** `period`: between samples in s; `secant`: Pa to either side over which the slope of the flow map is
    taken, by default as the observer does.

    **Raises:** `InputError` for a window of less than five samples, or one that is longer than the run.
    """
    length = run.time.shape[-1]
    if not 5 <= samples <= length:
        raise InputError(
            f"a window of observability must have 5 samples at least and {length}, the run's, at most, but it has "
            f"{samples}; use e.g. 500",
            "samples",
        )
    observer, states = controller.observer, estimates(controller, run, period)
    windows = length // samples
    deviations = jnp.stack(
        [*map(jnp.asarray, KNOWN_BEFOREHAND), observer.load_deviation, observer.level_deviation]
    ).astype(run.time.dtype)

    def onward(matrix: Array, inputs: tuple[LoadEstimate, Array]) -> tuple[Array, Array]:
        state, ambient = inputs
        matrix = transition(observer, state, ambient, period, secant) @ matrix
        return matrix, observer.free(state) * matrix[0]

    def window(inputs: tuple[LoadEstimate, Array]) -> Array:
        rows = jax.lax.scan(onward, jnp.diag(deviations), inputs)[1] / observer.position_noise
        return jnp.linalg.svd(rows, compute_uv=False)

    cut = jax.tree.map(
        lambda leaf: leaf[: windows * samples].reshape(windows, samples, *leaf.shape[1:]),
        (states, run.measured.ambient),
    )
    return jax.lax.map(window, cut)
