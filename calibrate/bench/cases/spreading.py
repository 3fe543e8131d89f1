"""What devices and processes bring on one machine: the same work by one, two, ... as many as there are cores."""

import contextlib
import json
import os
import pathlib
import shutil
import socket
import tempfile
from functools import partial

from ...output.files import SUMMARY
from ..commands import run_together
from ..served import Served
from ..table import Section, seconds, times
from ..timing import interleave
from ..workloads import BATCH_SECONDS, LANES
from .memory import STUDY

ROUNDS = 50
"""In turn, of which the best counts: what else runs takes cores from several devices before it takes them from one."""
SAMPLES = 200_000
"""Of the study that processes share: several times what a command takes to start."""
RUNS = 2
"""Commands with a filled cache, of which the best counts."""
WHOLE, SIMULATED, CPU = "whole command", "its samples and report", "of all processors"
COLUMNS = ("work", "processes", "devices of each", "time", "speed-up", "processor time")
_JACOBIAN, _BATCH = "jacobian of the example", f"batch of {LANES}, {BATCH_SECONDS:g} s"


def measure() -> Section:
    """Times a Jacobian and a batch by devices, and a whole command by processes."""
    section = Section("Devices and processes", _ABOUT, COLUMNS)
    counts = counts_to(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    for work, workload in ((_JACOBIAN, "jacobian"), (_BATCH, "batch")):
        _add_devices(section, work, workload, counts)
    _add_processes(section, counts)
    return section


def counts_to(cores: int) -> list[int]:
    """1, 2, 4, ... and the number of cores."""
    return sorted({*(1 << power for power in range(cores.bit_length())), cores})


def _add_devices(section: Section, work: str, workload: str, counts: list[int]) -> None:
    with contextlib.ExitStack() as stack:
        served = [stack.enter_context(Served(workload, count)) for count in counts]
        spent = {str(each.devices): list[float]() for each in served}
        contestants = {str(each.devices): partial(_note, spent[str(each.devices)], each) for each in served}
        timings, _ = interleave(contestants, ROUNDS)
    alone = min(timings["1"].rounds)
    for count, timing in timings.items():
        best = min(timing.rounds)
        processor = spent[count][1 + timing.rounds.index(best)]  # the first call compiled
        section.add(work, "1", count, seconds(best), times(alone / best), seconds(processor))


def _note(spent: list[float], served: Served) -> None:
    spent.append(served())


def _add_processes(section: Section, counts: list[int]) -> None:
    """Several processes with one device each, and one process with all devices."""
    shapes = [(count, 1) for count in counts] + [(1, count) for count in counts[-1:] if count > 1]
    with tempfile.TemporaryDirectory() as name:
        study = pathlib.Path(name) / "study.toml"
        study.write_text(STUDY.format(size=SAMPLES), encoding="utf-8")
        runs = {shape: [_tolerance(study, shape) for _ in range(1 + RUNS)] for shape in shapes}
    for what in (WHOLE, SIMULATED):
        alone = min(run[what] for run in runs[1, 1][1:])
        for (processes, devices), (_, *filled) in runs.items():
            best = min(filled, key=lambda run: run[what])
            processor = seconds(best[CPU]) if what == WHOLE else ""
            cells = (str(processes), str(devices), seconds(best[what]), times(alone / best[what]), processor)
            section.add(f"tolerance of {SAMPLES:,}, {what}", *cells)


def _tolerance(study: pathlib.Path, shape: tuple[int, int]) -> dict[str, float]:
    """s of one command by so many processes of so many devices: as a user waits for it, as it says itself of its
    samples and report, and of all processors."""
    processes, devices = shape
    out = study.parent / f"{processes} {devices}"
    command = ["tolerance", str(study), "--out", str(out)]
    company = ["--coordinator", f"localhost:{_free_port()}", "--processes", str(processes), "--process"]
    commands = [[*command, *company, str(index)] for index in range(processes)] if processes > 1 else [command]
    spent = run_together(commands, study.parent, devices)
    simulated = json.loads((out / SUMMARY).read_text(encoding="utf-8"))["wall_seconds"]
    shutil.rmtree(out)
    return {WHOLE: spent.wall, SIMULATED: simulated, CPU: spent.cpu}


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("localhost", 0))
        return probe.getsockname()[1]


_ABOUT = (
    f"{_JACOBIAN} and {_BATCH} by one process that sees so many devices, the best of {ROUNDS} rounds in turn; and the "
    f"command `tolerance` on {SAMPLES:,} loops of 2 s in single precision by so many processes of so many devices "
    f"each, the best of {RUNS} with a filled cache, whole and without its start. Processor time is that of all cores "
    "together: where other things run, it says better than the clock what more devices cost. Speed-ups are over one."
)
