"""A command watched from inside: `python -m calibrate.bench.watched TIMES.json COMMAND ...`.

A thread looks at the stack of the main one every few milliseconds, and adds up the time by what that is at.
"""

import collections
import json
import pathlib
import sys
import threading
import time
import types

EVERY = 5e-3
"""s between two looks."""
REST = "the rest"
AT = {
    "waiting for a program that another thread makes": (("_kept.py", "_program"), ("threading.py", "wait")),
    "programs from disk": (("_kept.py", "_load"),),
    "compilation by LLVM": (("/jax/", "backend_compile"),),
    "tracing and lowering": (("_kept.py", "_make"),),
    "small programs of JAX": (("/jax/", "cache_miss"),),
    "simulations and their derivatives": (("_programs.py", "_evaluate"),),
    "simulations side by side": (("_programs.py", "_simulate"),),
    "imports": (("<frozen importlib", ""),),
    "report and files": (("/output/", ""),),
    "the rest of the report": (("report.py", ""),),
    "linear algebra": (("/estimation/", ""),),
    "regressions of identification": (("/identification/", ""),),
}
"""What a stack is at: the first that has all its pairs of a part of a file's name and a function's beginning."""


def main() -> None:
    """Runs a command, and writes the s that it spent at each thing."""
    _, times, *arguments = sys.argv
    stop, spent = threading.Event(), collections.defaultdict[str, float](float)
    looking = threading.Thread(target=_watch, args=(threading.get_ident(), stop, spent))
    looking.start()
    sys.argv = ["calibrate", *arguments]
    try:
        from ..__main__ import main as run

        run(prog_name="python -m calibrate")
    finally:
        stop.set()
        looking.join()
        pathlib.Path(times).write_text(json.dumps(spent), encoding="utf-8")


def _watch(thread: int, stop: threading.Event, spent: dict[str, float]) -> None:
    before = time.perf_counter()
    while not stop.wait(EVERY):
        now = time.perf_counter()
        spent[kind_of(sys._current_frames().get(thread))] += now - before
        before = now


def kind_of(frame: types.FrameType | None) -> str:
    """What a thread is at, by the stack that ends in a frame."""
    stack = []
    while frame is not None:
        stack.append((frame.f_code.co_filename, frame.f_code.co_name))
        frame = frame.f_back
    for kind, pairs in AT.items():
        if all(any(file in name and code.startswith(function) for name, code in stack) for file, function in pairs):
            return kind
    return REST


if __name__ == "__main__":
    main()
