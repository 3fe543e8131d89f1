"""What a fit says of its posterior: draws that go on where they were interrupted, and how they compare with errors."""

import dataclasses
import io
import pathlib
import zipfile
from typing import Any

import numpy as np

from vgtjax import Calibration
from vgtjax.assurance import CHAINS, WARM_UP, Drawn, Posterior, Sampler
from vgtjax.estimation import End

from ..output.console import console
from ..output.files import replacing

LEAST = 4
"""Draws of each chain with which its halves can be compared at all."""
FILE = "posterior.npz"
"""Draws of all chains, in whitened coordinates while they are under way and in SI units behind them at the end."""


@dataclasses.dataclass(frozen=True, eq=False)
class DrawnEntry:
    """One entry: what the draws say, and the linear interval of the fit's noise beside it."""

    name: str
    median: float
    low: float
    high: float
    ratio: float
    """Length of the draws' interval over that of the linear one."""
    mixing: float
    effective: float

    def summary(self) -> dict[str, Any]:
        """For `summary.json`."""
        return {
            "median": self.median,
            "interval": [self.low, self.high],
            "length_over_linear": self.ratio,
            "r_hat": self.mixing,
            "effective_draws": self.effective,
        }


def sample(end: End, draws: int, folder: pathlib.Path, who: str) -> Posterior:
    """At least `draws` draws from the posterior at the end of a fit; those that an earlier run has left are kept.

    **Raises:** `InputError` without the package that draws.
    """
    sampler, path = Sampler(end), folder / FILE
    drawn = _load(path, sampler.first())
    wanted = WARM_UP + max(LEAST, -(-draws // CHAINS))
    if drawn.count:
        console.print(f"{who}resuming with {drawn.count} draws of each of {CHAINS} chains")
    with console.status(f"{who}the posterior") as status:
        while drawn.count < wanted:
            drawn = sampler.onward(drawn)
            _save(path, dataclasses.asdict(drawn))
            status.update(f"{who}the posterior: {drawn.count} of {wanted} draws of each of {CHAINS} chains")
    found = sampler.posterior(drawn)
    _save(path, {**dataclasses.asdict(drawn), "entries": np.array(found.entries), "draws": found.draws})
    return found


def rows(posterior: Posterior, calibration: Calibration) -> list[DrawnEntry]:
    """Every estimable entry; `calibration` has the linear interval of it."""
    # The draws know of the noise only, so the other parts of an error are left out of what they are compared with.
    by_noise = dict(zip(calibration, calibration.budget.noise.tolist(), strict=True))
    found = []
    for number, name in enumerate(posterior.entries):
        if name not in by_noise:
            continue
        known = calibration[name]
        low, high = posterior.intervals[number].tolist()
        linear = float(np.ptp(known.interval)) * (by_noise[name] / known.std_error)
        found.append(
            DrawnEntry(
                name,
                float(posterior.medians[number]),
                low,
                high,
                (high - low) / linear,
                float(posterior.mixing[number]),
                float(posterior.effective[number]),
            )
        )
    return found


def summary(posterior: Posterior, calibration: Calibration) -> dict[str, Any]:
    """For `summary.json`."""
    chains, draws, _ = posterior.draws.shape
    return {
        "chains": chains,
        "draws": chains * draws,
        "divergent": posterior.divergent,
        "verdict": posterior.verdict,
        "parameters": {row.name: row.summary() for row in rows(posterior, calibration)},
    }


def _save(path: pathlib.Path, arrays: dict[str, np.ndarray]) -> None:
    """Whole or not at all."""
    with replacing(path) as new:
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **arrays)
        new.write_bytes(content.getvalue())


def _load(path: pathlib.Path, nothing: Drawn) -> Drawn:
    """What an earlier run has drawn; nothing where that can't be read, or is of other directions."""
    try:
        with np.load(path) as content:
            found = Drawn(content["places"], content["acceptance"], content["divergent"])
    except (OSError, KeyError, ValueError, zipfile.BadZipFile):
        return nothing
    return found if found.places.shape[::2] == nothing.places.shape[::2] else nothing
