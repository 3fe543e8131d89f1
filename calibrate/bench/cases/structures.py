"""What `compare` says of traces whose structure is known: how the duty was held, the exponent of the Stribeck curve,
the law of the vane force, and the family of friction."""

import collections
import dataclasses
import functools
import json
import pathlib
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgtjax.parts import OPERATING_POINTS

from ..campaigns import draw_unit, record_structure, write_csv
from ..commands import run_command
from ..kept import Cells, KeptRows
from ..structured_plant import Structure, VaneLaw
from ..table import Section

SEEDS = (1400, 2400)
"""Of the first campaign of each dozen; every campaign has its own. Rules were made on the first dozen only."""
FRICTION = "lugre"
"""The family of the plant."""
RIGHT, OPEN, WRONG = "decided, right", "cannot tell", "decided, wrong"


@dataclasses.dataclass(frozen=True)
class Campaign:
    """A unit of known structure: its slow loops, at turbine pressures in Pa gauge, and random levels of which the
    record keeps `every` so many milliseconds."""

    structure: Structure
    pressures: tuple[float, ...]
    every: int

    @property
    def stated(self) -> VaneLaw:
        """The vane law of the study from which `compare` begins: never the right one."""
        return "speed-map" if self.structure.vane_force == "map" else "map"

    def __str__(self) -> str:
        made = self.structure
        loops = ", ".join(f"{pressure / 100:g}" for pressure in self.pressures)
        law = {"none": "no vane force", "map": "by distance", "speed-map": "by speed"}[made.vane_force]
        return f"{made.duty_hold}, {made.stribeck_exponent}, {law}; {loops} mbar, {1000 // self.every} Hz"


ONE, TWO, THREE = (3e5,), (0.0, 3e5), OPERATING_POINTS
CAMPAIGNS = (
    Campaign(Structure("zero-order", 1, "speed-map"), THREE, 2),
    Campaign(Structure("linear", 2, "map"), TWO, 2),
    Campaign(Structure("zero-order", 2, "none"), ONE, 1),
    Campaign(Structure("linear", 1, "none"), THREE, 2),
    Campaign(Structure("zero-order", 1, "map"), ONE, 2),
    Campaign(Structure("linear", 2, "speed-map"), THREE, 1),
    Campaign(Structure("zero-order", 2, "map"), THREE, 2),
    Campaign(Structure("linear", 1, "speed-map"), TWO, 2),
    Campaign(Structure("zero-order", 1, "none"), TWO, 2),
    Campaign(Structure("linear", 1, "map"), ONE, 1),
    Campaign(Structure("zero-order", 2, "speed-map"), TWO, 1),
    Campaign(Structure("linear", 2, "none"), ONE, 2),
)
"""Every hold with every exponent and every vane law; the first few have each of them."""
_ABOUT = (
    f"{len(SEEDS)} times {len(CAMPAIGNS)} random actuators of known structure, simulated by a hard-switching plant "
    "that is not the model's code (RK4, 10 us; the force of the gas is a smooth function of the crank angle): a slow "
    "loop of 30 s at 100 Hz at each turbine pressure, and 5 s of random levels without gas at 500 Hz or 1 kHz, noise "
    "of 8 um and 60 Pa, offsets. The command `compare`, of a study that begins with a wrong vane force and says no "
    "more."
)


def measure(keep: pathlib.Path | None = None) -> Section:
    """Compares the structures of every campaign as a user does, in a process of its own.

    **Arguments:** `keep`: a file for the answers of finished campaigns, from which another call goes on.
    """
    kept = KeptRows(keep, _ABOUT)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        answers = [
            kept.row(f"{seed + number}: {campaign}", functools.partial(_compared, campaign, seed + number, folder))
            for seed in SEEDS
            for number, campaign in enumerate(CAMPAIGNS)
        ]
    return tabulate(len(SEEDS) * CAMPAIGNS, [json.loads(summary) for (summary,) in answers])


def _compared(campaign: Campaign, seed: int, folder: pathlib.Path) -> Cells:
    """What `compare` says of a campaign, as text."""
    rng = np.random.default_rng(seed)
    place = folder / str(seed)
    place.mkdir()
    for trace in record_structure(draw_unit(rng), campaign.structure, campaign.pressures, campaign.every, rng):
        write_csv(trace, place / f"{trace.name}.csv")
    study = place / "study.toml"
    stated = f'[components]\nvane_force = "{campaign.stated}"\n[[trace]]\nfile = "*.csv"\n'
    study.write_text(stated, encoding="utf-8")
    took = run_command(["compare", str(study), "--out", str(place / "out")], folder)
    summary = json.loads((place / "out" / "summary.json").read_text(encoding="utf-8"))
    said = {name: summary[name] for name in ("chosen", "decided", "reasons", "table", "remains")}
    return (json.dumps({**said, "seconds": took}),)


def truth_of(structure: Structure) -> dict[str, Any]:
    """What `compare` should choose, or say that it cannot tell."""
    return {
        "duty_hold": structure.duty_hold,
        "stribeck_exponent": structure.stribeck_exponent,
        "vane_force": structure.vane_force,
        "friction": FRICTION,
    }


def outcomes(structure: Structure, summary: Mapping[str, Any]) -> dict[str, str]:
    """For each question, whether a comparison decided it, and rightly."""
    chosen, decided = summary["chosen"], summary["decided"]
    return {
        name: OPEN if not decided[name] else RIGHT if chosen[name] == right else WRONG
        for name, right in truth_of(structure).items()
    }


def tabulate(campaigns: Sequence[Campaign], summaries: Sequence[Mapping[str, Any]]) -> Section:
    """A row for each question, then one for each campaign with what was said of it."""
    section = Section("Does `compare` find what made the traces?", _ABOUT, ("question", RIGHT, OPEN, WRONG))
    found = [outcomes(each.structure, summary) for each, summary in zip(campaigns, summaries, strict=True)]
    for question in truth_of(Structure()):
        counts = collections.Counter(each[question] for each in found)
        section.add(question, *(str(counts[outcome]) for outcome in (RIGHT, OPEN, WRONG)))
    for campaign, each, summary in zip(campaigns, found, summaries, strict=True):
        said = ", ".join(f"{name} {summary['chosen'][name]} ({outcome})" for name, outcome in each.items())
        section.notes.append(f"{campaign}: {said}; {summary['seconds']:.0f} s")
    return section
