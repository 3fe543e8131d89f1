"""The commands and their options: reads the command line, runs a command, and says in one sentence what went wrong."""

import contextlib
import importlib
import importlib.util
import os
import pathlib
import signal
import sys
import types
from collections.abc import Callable
from typing import Any, NoReturn

import click

PATH = click.Path(path_type=pathlib.Path)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Calibrates electro-pneumatic actuators from bench traces by exact gradients."""


Decorator = Callable[[Callable[..., None]], Any]
OUT = click.option("--out", type=PATH, required=True, metavar="DIR", help="Folder for the results.")
START = "Start from a parameters.json, or from the folder of a fit with several units."
POPULATION = "The nominal actuator's parameters.json, or the folder of a fit with several units: the population."


def _study_command(parameters: str, *options: Decorator) -> Decorator:
    """A command on a study; what `--parameters` is for, and options of its own."""
    given = click.option("--parameters", type=PATH, metavar="FILE", help=parameters)

    def decorate(function: Callable[..., None]) -> Any:
        for each in (*options, OUT, given, click.argument("study", type=PATH, required=False)):
            function = each(function)
        return main.command()(function)

    return decorate


def _population_command(function: Callable[..., None]) -> Any:
    """A command that may run in several processes."""
    options = (
        click.option("--process", type=int, metavar="INDEX", help="Which of them this one is, from 0."),
        click.option("--processes", type=int, metavar="COUNT", help="How many processes run this command together."),
        click.option("--coordinator", metavar="HOST:PORT", help="Where the first of several processes listens."),
    )
    return _study_command(POPULATION, *options)(function)


@_study_command(START)
def simulate(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Runs the model on every trace of STUDY (a TOML file; a small example if omitted)."""
    _run("simulate", study, parameters, out)


@_study_command(START)
def fit(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Calibrates the model to the traces of STUDY (a TOML file; a small example if omitted)."""
    _run("fit", study, parameters, out)


@main.command()
@OUT
def reproduce(out: pathlib.Path) -> None:
    """Checks the numbers of the thesis's chapters 2 to 5 against this model."""
    _run("reproduction", out)


@_study_command(START)
def identify(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Identifies part by part from STUDY, as its traces allow (a TOML file; a small example if omitted)."""
    _run("identify", study, parameters, out)


@_study_command(START)
def tune(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path) -> None:
    """Tunes a controller's gains by the gradient of its closed loops (a fleet of twenty if STUDY is omitted)."""
    _run("tune", study, parameters, out)


@_population_command
def tolerance(study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path, **processes: Any) -> None:
    """Simulates a population of actuators: spread, yield, envelopes (a fleet of twenty if STUDY is omitted)."""
    _run("tolerance", study, parameters, out, processes=processes)


@_population_command
def sensitivity(
    study: pathlib.Path | None, parameters: pathlib.Path | None, out: pathlib.Path, **processes: Any
) -> None:
    """Ranks what the spread of a population comes from (a fleet of twenty if STUDY is omitted)."""
    _run("sensitivity", study, parameters, out, processes=processes)


def _prepare_jax(processes: dict[str, Any] | None) -> None:
    """Fast settings and a persistent cache, before anything compiles. Here, so that --help needs no JAX."""
    import platformdirs

    from vgtjax import configure

    configure(cache=platformdirs.user_cache_path("vgtjax") / "compiled")
    if processes is not None:
        from .population import join

        join(processes["coordinator"], processes["processes"], processes["process"])


def _run(command: str, *arguments: pathlib.Path | None, processes: dict[str, Any] | None = None) -> None:
    """Runs a command; what went wrong becomes one sentence and an exit status."""
    previous = signal.signal(signal.SIGINT, _leave)
    try:
        from vgtjax import InputError, SimulationError

        try:
            _prepare_jax(processes)
            module = _load(command)

            from .study.places import OF_A_MODEL, stated

            with stated(OF_A_MODEL):
                module.run(*arguments)
        except InputError as error:
            click.echo(f"error: {error}", err=True)
            sys.exit(2)
        except SimulationError as error:
            click.echo(f"failed: {error}", err=True)
            sys.exit(1)
        except OSError as error:
            click.echo(f"failed: {error.filename or 'a file'} can't be written ({error.strerror}); make room", err=True)
            sys.exit(1)
    finally:
        signal.signal(signal.SIGINT, previous)


def _load(command: str) -> types.ModuleType:
    """The module of a command, imported only now, so that help needs none of them.

    **Raises:** `InputError` when it is left out of an installed package.
    """
    from vgtjax import InputError

    if importlib.util.find_spec(f".{command}", __package__) is None:
        raise InputError("this command needs a source checkout, but this is an installed package; run it in a clone")
    return importlib.import_module(f".{command}.command", __package__)


def _leave(number: int, frame: types.FrameType | None) -> NoReturn:
    """Ends the process at once; files are written whole, so the same command goes on from what is there.

    A `KeyboardInterrupt` got lost where Python ignores exceptions, in callbacks of imports and of garbage collection.
    """
    with contextlib.suppress(RuntimeError):  # interrupted while it was flushing
        sys.stdout.flush()
    show_cursor = "\x1b[?25h\n" if sys.stdout.isatty() else ""
    os.write(2, f"{show_cursor}interrupted; the same command goes on from here\n".encode())
    os._exit(130)
