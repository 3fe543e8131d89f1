"""The command `flow`: the map of the nozzle, the flow along its passage, and what a pulsating engine makes of it."""

import dataclasses
import hashlib
import importlib.metadata
import pathlib
import time

import vgtjax
from vgtjax import SimulationError
from vgtjax.parts import Stage
from vgtjax.plants import Rod

from ..output.console import console
from ..output.files import REPORT, SUMMARY, write_json, write_text
from ..output.software import software
from ..resumable import run_once
from ..study.disturbances import PulsationTable
from ..study.read import fingerprint, load_study
from .nozzle_map import NozzleMap, solve_map
from .passages import along_passage, to_csv
from .pulse import Pulse, engine_pulse, not_counted
from .report import render
from .stage import parts_of, turbine_of

ASSUMED = (
    "the geometry of the nozzle and the state of the gas are assumed, as no source gives them, and no measured vane "
    "force validates this"
)


def run(study: pathlib.Path | None, out: pathlib.Path) -> None:
    """Writes `map.csv`, `passage.csv`, `summary.json` and `report.html`.

    **Raises:** `InputError` for a geometry that does not work, before anything is written; `SimulationError` that names
    the point at which no steady state is found.
    """
    subject = Subject(Stage()) if study is None else Subject.of(study)
    subject.stage.require_working()
    run_once(out, "flow", subject.digest, lambda: _compute(subject, out))


@dataclasses.dataclass(frozen=True, eq=False)
class Subject:
    """What the command is about, with the text of its study and a digest of all: the default stage without a study,
    whose turbine is made late, as it takes long."""

    stage: Stage
    turbine: vgtjax.Turbine | None = None
    rod: Rod = dataclasses.field(default_factory=Rod)
    engine: PulsationTable | None = None
    text: str = ""
    digest: str = hashlib.sha256(importlib.metadata.version("vgtjax").encode()).hexdigest()

    @staticmethod
    def of(path: pathlib.Path) -> "Subject":
        """That of the study in a file."""
        study = load_study(path)
        turbine, rod = parts_of(study)
        text = path.read_text(encoding="utf-8-sig")
        return Subject(turbine.stage, turbine, rod, study.pulsation, text, fingerprint(study, [], {}))


def _compute(subject: Subject, out: pathlib.Path) -> None:
    began = time.monotonic()
    with console.status("the map of the nozzle"):
        found = solve_map(subject.stage)
    with console.status("the flow along its passage"):
        along = along_passage(subject.stage)
    with console.status("an engine that pulsates"):
        turbine = subject.turbine or turbine_of(subject.stage)
        pulse, notes = _pulse(turbine, subject)
    seconds = time.monotonic() - began
    summary = {
        **found.summary(),
        "pulsation": None if pulse is None else pulse.summary(),
        "notes": notes,
        "wall_seconds": round(seconds, 3),
        "software": software(),
    }
    write_text(out / "map.csv", found.to_csv())
    write_text(out / "passage.csv", to_csv(along))
    write_json(out / SUMMARY, summary)
    write_text(out / REPORT, render(turbine, found, along, pulse, summary, subject.text))
    _say(found, notes)


def _pulse(turbine: vgtjax.Turbine, subject: Subject) -> tuple[Pulse | None, list[str]]:
    """The pulse, if the engine runs before this turbine, and what must be said of all."""
    left_out = not_counted(turbine, subject.engine)
    notes = [ASSUMED] if left_out is None else [ASSUMED, left_out]
    try:
        return engine_pulse(turbine, subject.engine, subject.rod), notes
    except SimulationError as error:
        return None, [*notes, f"no pulsation is shown, as {error}"]


def _say(found: NozzleMap, notes: list[str]) -> None:
    for note in notes:
        console.print(f"note: {note}")
    for name, row in found.summary()["quantities"].items():
        least, most = (
            f"{row[kind]['value']:.5g} {row['unit']} at {row[kind]['total_pressure'] / 1e5:.3g} bar and "
            f"{row[kind]['crank_angle']:.3g} deg"
            for kind in ("least", "most")
        )
        console.print(f"{name}: {least}, to {most}")
