"""Draws from the posterior of a fit: the No-U-Turn sampler of BlackJAX (Hoffman and Gelman, 2014) in coordinates in
which the posterior of a linear model would be standard normal."""

import dataclasses
import functools
import importlib
import types
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._errors import InputError
from .._types import Scalar, Vector
from ..estimation import End, FitProblem

CHAINS = 4
"""Chains that begin apart: that they come to the same is what says that they have come to the posterior."""
WARM_UP = 30
"""Draws of each chain that only find its step size, of which the first guess is a good one."""
ACCEPTANCE = 0.8
"""Share of the points of a path that should be good ones (Hoffman and Gelman, 2014, section 4.3)."""
FIRST_SIZE = 0.5
"""Step size to begin with: 0.9 of the points were good with it on 26 parameters of a unit."""
MOST_DOUBLINGS = 6
"""Of the length of a path: 63 steps, where a normal posterior takes 7."""
MIXED = 1.05
"""R-hat up to which chains have mixed; 1.01 is asked of those from which tails are read (Vehtari et al., 2021)."""


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """What the chains have drawn so far, warm-up included, in whitened coordinates; nothing else is needed to go on."""

    places: Float[np.ndarray, "chains draws directions"]
    acceptance: Float[np.ndarray, "chains draws"]
    divergent: Bool[np.ndarray, "chains draws"]

    @property
    def count(self) -> int:
        """Draws of each chain."""
        return self.places.shape[1]


@dataclasses.dataclass(frozen=True, eq=False)
class Posterior:
    """Draws `(chains, draws, entries)` of the estimable `entries` in the units of the table.

    `mixing` is the rank-normalised R-hat of each entry, `effective` the number of independent draws that its bulk is
    worth (Vehtari et al., 2021), at most all of them; `divergent` counts paths that left the finite numbers or a bound.
    """

    entries: tuple[str, ...]
    draws: Float[np.ndarray, "chains draws entries"]
    mixing: Float[np.ndarray, " entries"]
    effective: Float[np.ndarray, " entries"]
    divergent: int

    @property
    def intervals(self) -> Float[np.ndarray, "entries 2"]:
        """Ends between which 95 % of the draws of each entry lie."""
        return np.quantile(self.draws.reshape(-1, len(self.entries)), [0.025, 0.975], axis=0).T

    @property
    def medians(self) -> Float[np.ndarray, " entries"]:
        """Median of the draws of each entry."""
        return np.median(self.draws.reshape(-1, len(self.entries)), axis=0)

    @property
    def verdict(self) -> str:
        """Whether the draws may be used."""
        worst = float(np.max(self.mixing))
        if not worst <= MIXED:
            return f"the chains have not mixed (R-hat up to {worst:.3g}): take more draws"
        return f"the chains have mixed (R-hat up to {worst:.3g})"


Flag = Bool[Array, ""]


class _Target(eqx.Module):
    """The posterior in whitened coordinates; its scale is that of what remains at the end of the fit."""

    problem: FitProblem
    at: Float[np.ndarray, " coordinates"]
    moves: Float[np.ndarray, "coordinates directions"]
    scale: Scalar
    chi2: Scalar

    def coordinates(self, place: Vector) -> Float[Array, " coordinates"]:
        """Those of the fit."""
        return self.at + self.moves @ place

    def is_inside(self, place: Vector) -> Flag:
        """Whether a place keeps to the bounds."""
        there, transform = self.coordinates(place), self.problem.transform
        return jnp.all((there >= transform.lower) & (there <= transform.upper))

    def log_density(self, place: Vector) -> Scalar:
        """Logarithm of the density over that at the end of the fit; nothing is likely beyond a bound."""
        chi2 = self.problem.count * jnp.sum(self.problem.residuals(self.coordinates(place)) ** 2)
        return jnp.where(self.is_inside(place), 0.5 * (self.chi2 - chi2) / self.scale, -jnp.inf)


class Sampler:
    """Draws from the posterior around the end of a fit, chain by chain.

    The likelihood has the sensors as the fit found them, corrections of numerical errors included; what is held with a
    tolerance is not varied, nor is what is not estimable.

    **Arguments:** `seed`: each draw is one of this, its chain and its number, so that draws that are gone on with are
    those of a run that never stopped.

    **Raises:** `InputError` without BlackJAX.
    """

    def __init__(self, end: End, seed: int = 0):
        self.end, self._seed = end, seed
        self._blackjax = require_blackjax()
        scale, chi2 = jnp.asarray(end.found.scale), jnp.asarray(end.point.chi2)
        self._target = _Target(end.problem, end.at, end.directions.moves, scale, chi2)

    def first(self) -> Drawn:
        """Nothing drawn yet."""
        directions = self._target.moves.shape[1]
        return Drawn(np.zeros((CHAINS, 0, directions)), np.zeros((CHAINS, 0)), np.zeros((CHAINS, 0), bool))

    def onward(self, drawn: Drawn) -> Drawn:
        """One more draw of each chain."""
        found = [self._draw(chain, drawn) for chain in range(CHAINS)]
        places, acceptance, divergent = (np.array(each)[:, None] for each in zip(*found, strict=True))
        return Drawn(
            np.concatenate([drawn.places, places], axis=1),
            np.concatenate([drawn.acceptance, acceptance], axis=1),
            np.concatenate([drawn.divergent, divergent], axis=1),
        )

    def posterior(self, drawn: Drawn) -> Posterior:
        """What draws after the warm-up say."""
        target, known = self._target, self.end.found.estimable
        kept = drawn.places[:, WARM_UP:]
        coordinates = jax.vmap(jax.vmap(target.coordinates))(jnp.asarray(kept))
        values = np.asarray(jax.vmap(jax.vmap(target.problem.transform.to_physical))(coordinates))[..., known]
        entries = tuple(entry for entry, is_known in zip(self.end.entries, known, strict=True) if is_known)
        diagnostics = self._blackjax.diagnostics
        with jax.numpy_rank_promotion("allow"):
            mixing, effective = jax.jit(lambda draws: (diagnostics.rhat(draws), diagnostics.ess_bulk(draws)))(values)
        return Posterior(
            entries, values, np.asarray(mixing), np.asarray(effective), int(np.sum(drawn.divergent[:, WARM_UP:]))
        )

    def _draw(self, chain: int, drawn: Drawn) -> tuple[np.ndarray, float, bool]:
        key = jax.random.fold_in(jax.random.fold_in(jax.random.key(self._seed), chain), drawn.count)
        place = jnp.asarray(drawn.places[chain, -1]) if drawn.count else self._apart(chain)
        size = jnp.asarray(self._size(drawn.acceptance[chain, :WARM_UP]))
        state, path = _onward()(self._target, key, place, size)
        return np.asarray(state.position), float(path.acceptance_rate), bool(path.is_divergent)

    def _apart(self, chain: int) -> Array:
        """Where a chain begins: a draw from the posterior of the linear model, as far towards it as bounds allow."""
        key = jax.random.fold_in(jax.random.key(self._seed), CHAINS + chain)
        far = jax.random.normal(key, self._target.moves.shape[1:])
        inside = [part * far for part in (1.0, 0.5, 0.25) if self._target.is_inside(part * far)]
        return inside[0] if inside else jnp.zeros_like(far)

    def _size(self, acceptance: Float[np.ndarray, " draws"]) -> float:
        """The step size by the paths of a chain's warm-up (dual averaging, Nesterov, 2009)."""
        begin, update, final = self._blackjax.adaptation.step_size.dual_averaging_adaptation(ACCEPTANCE)
        state = begin(FIRST_SIZE)
        for share in acceptance.tolist():
            state = update(state, share)
        return float(final(state) if len(acceptance) == WARM_UP else np.exp(state.log_step_size))


@functools.cache
def _onward() -> Callable[[_Target, Array, Array, Array], tuple[Any, Any]]:
    """The state after a path, and what it was like; compiled once for all samplers of the same problem."""
    nuts = require_blackjax().mcmc.nuts
    kernel = nuts.build_kernel()

    def onward(target: _Target, key: Array, place: Array, size: Array) -> tuple[Any, Any]:
        state, metric = nuts.init(place, target.log_density), jnp.ones_like(place)
        return kernel(key, state, target.log_density, size, metric, max_num_doublings=MOST_DOUBLINGS)

    return eqx.filter_jit(onward)


def require_blackjax() -> types.ModuleType:
    """The package that draws.

    **Raises:** `InputError` where it is not installed.
    """
    try:
        return importlib.import_module("blackjax")
    except ImportError as error:
        raise InputError(
            "draws from a posterior need the package blackjax, which is not installed; run pip install "
            "'.[posterior]' in a clone of vgtjax",
            "posterior",
        ) from error
