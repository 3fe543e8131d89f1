"""The command line of the benchmarks: `python -m calibrate.bench`."""

import importlib.metadata
import os
import pathlib
import platform
import sys
import tempfile

import click

_CASES = (
    "forward",
    "jacobian",
    "batch",
    "fit",
    "flow",
    "nozzle",
    "pulsating-flow",
    "engine-cycle",
    "choked-flow",
    "random-nozzles",
    "scaling",
    "spreading",
    "iterations",
    "cold-start",
    "first-answer",
    "population",
    "tuning",
    "opponents",
    "observers",
    "observability",
    "margins",
    "samples",
    "robustness",
    "coverage",
    "fleet-coverage",
    "fleet",
    "unit-profile",
    "kills",
    "assurance",
    "recovery",
    "structures",
    "accelerator",
    "memory",
    "files",
    "unknown-plants",
    "wider-plants",
    "adaptive-gains",
)
_LONG = (
    "accelerator",
    "nozzle",
    "pulsating-flow",
    "choked-flow",
    "random-nozzles",
    "spreading",
    "iterations",
    "tuning",
    "opponents",
    "observers",
    "observability",
    "margins",
    "samples",
    "coverage",
    "fleet-coverage",
    "fleet",
    "unit-profile",
    "kills",
    "assurance",
    "recovery",
    "structures",
    "memory",
    "unknown-plants",
    "wider-plants",
    "adaptive-gains",
)
"""Only when asked for: minutes, another question than speed, or a device that most machines lack."""
_KEPT = ("opponents", "tuning", "coverage", "structures", "wider-plants", "adaptive-gains")
_KEEP = f"What is finished of {', '.join(_KEPT)}; the same command goes on from there, unless the code has changed."
_PACKAGES = ("jax", "diffrax", "numba", "scipy", "casadi", "cma")


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--out", type=click.Path(path_type=pathlib.Path), metavar="FILE.md", help="Also write markdown.")
@click.option("--only", type=click.Choice(_CASES), multiple=True, help="Only this benchmark; may be repeated.")
@click.option("--keep", type=click.Path(path_type=pathlib.Path), metavar="FILE.json", help=_KEEP)
def main(out: pathlib.Path | None, only: tuple[str, ...], keep: pathlib.Path | None) -> None:
    """Times this package beside what a user would write instead; about five minutes on two cores."""
    from vgtjax import InputError, configure

    with tempfile.TemporaryDirectory() as cache:
        # A new one: first calls compile as they should, and a second fit finds what the command line would find.
        configure(cache=cache)
        try:
            _measure(only or tuple(name for name in _CASES if name not in _LONG), out, keep)
        except InputError as error:
            click.echo(f"error: {error}", err=True)
            sys.exit(2)


def _measure(names: tuple[str, ...], out: pathlib.Path | None, keep: pathlib.Path | None) -> None:
    import rich.console

    from .cases import find_case
    from .table import show, to_markdown

    # Without a terminal rich assumes 80 columns, which would cut the tables.
    console = rich.console.Console(width=None if sys.stdout.isatty() else 150)
    machine = _machine()
    console.print(machine, highlight=False)
    sections = []
    for name in names:
        with console.status(f"measuring {name}"):
            sections.append(find_case(name)(keep) if name in _KEPT else find_case(name)())
        show(sections[-1], console)
        if out is not None:
            # After every benchmark, so that an interrupted run keeps what it measured.
            out.write_text(to_markdown(sections, machine), encoding="utf-8")


def _machine() -> str:
    versions = ", ".join(f"{name} {_version(name)}" for name in _PACKAGES)
    load = os.getloadavg()[0]
    return (
        f"{len(os.sched_getaffinity(0))} cores ({platform.machine()}, {platform.system()}), Python "
        f"{platform.python_version()}, {versions}; load before the start {load:.1f}. Times are medians of rounds in "
        "which all contestants take turns; a ratio above one says how many times longer than the first row it took."
    )


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


if __name__ == "__main__":
    main(prog_name="python -m calibrate.bench")
