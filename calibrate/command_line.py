"""The commands and their options: reads the command line, runs a command, and says in one sentence what went wrong."""

import contextlib
import functools
import gc
import importlib
import importlib.util
import os
import pathlib
import signal
import sys
import types
from collections.abc import Iterator
from typing import Any, NoReturn

import click

from .temporary import remove_temporary

PATH = click.Path(path_type=pathlib.Path)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Calibrates electro-pneumatic actuators from bench traces by exact gradients."""


STUDY = click.Argument(["study"], type=PATH, required=False)
OUT = click.Option(["--out"], type=PATH, required=True, metavar="DIR", help="Folder for the results.")
SEEN = click.Option(["--out"], type=PATH, metavar="DIR", help="Folder for the results; without it they are only said.")
START = "Start from a parameters.json, a CDFX or a DCM file, or from the folder of a fit with several units."
KNOWN = "What is simulated: a parameters.json, or what else a fit may start from; without it the study's values."
DERIVED = (
    "Where derivatives are taken: a parameters.json, or what else a fit may start from; else at the study's values."
)
CONTROLLED = (
    "What is controlled: a parameters.json, or the folder of a fit with several units; not the gains to start from."
)
GAINS = click.Option(
    ["--gains"], type=PATH, metavar="FILE", help="A gains.json that tune wrote, or its folder; else the study's gains."
)
CAMPAIGNS = click.Option(
    ["--campaigns"], type=click.IntRange(2), default=64, show_default=True, metavar="K", help="How many."
)
RESULTS = click.Argument(["results"], type=PATH)
FORMATS = ("csv", "cdfx", "dcm", "mat", "fmu")
FORMAT = click.Option(["--format", "kind"], type=click.Choice(FORMATS), required=True, help="What the file is.")
FILE = click.Option(["--out"], type=PATH, required=True, metavar="FILE", help="The file to write.")
DATE = click.Option(
    ["--date"],
    type=click.DateTime(["%Y-%m-%d"]),
    metavar="YYYY-MM-DD",
    help="Of the calibration, in the file; else today.",
)
EXPORT = "Writes RESULTS (of the fit of one actuator, or of tune) as a file for other tools."
POPULATION = "The nominal actuator's parameters.json, or the folder of a fit with several units: the population."
PROCESSES = (
    click.Option(["--process"], type=int, metavar="INDEX", help="Which of them this one is, from 0."),
    click.Option(["--processes"], type=int, metavar="COUNT", help="How many processes run this command together."),
    click.Option(["--coordinator"], metavar="HOST:PORT", help="Where the first of several processes listens."),
)
ROOMS = {"check": "assurance.check", "recover": "assurance.recover", "reproduce": "reproduction"}
"""Of commands that are not in a room of their own name."""
SMALL = "(a TOML file; a small simulated example if omitted)."
FLEET = "(a simulated fleet of twenty if STUDY is omitted)."


def _prepare_jax(processes: dict[str, Any]) -> None:
    """Fast settings and a persistent cache, before anything compiles. Here, so that --help needs no JAX."""
    import platformdirs

    from vgtjax import configure

    configure(cache=platformdirs.user_cache_path("vgtjax") / "compiled")
    if processes:
        from .processes import join

        join(processes["coordinator"], processes["processes"], processes["process"])


def _company(processes: dict[str, Any]) -> contextlib.AbstractContextManager[None]:
    """What the death of another process is noticed in, for a command that runs in several."""
    if not processes:
        return contextlib.nullcontext()
    from .processes import bereaved

    return bereaved()


def _run(command: str, **arguments: Any) -> None:
    """Runs a command; what went wrong becomes one sentence and an exit status."""
    previous = signal.signal(signal.SIGINT, _leave)
    try:
        from vgtjax import InputError, SimulationError

        try:
            processes = {option.name: arguments.pop(option.name) for option in PROCESSES if option.name in arguments}
            with _importing():
                _prepare_jax(processes)
                module = _load(command)

            from .study.places import OF_A_MODEL, stated

            with stated(OF_A_MODEL), _company(processes):
                module.run(**arguments)
        except InputError as error:
            click.echo(f"error: {_in_study(error, arguments.get('study'))}{error}", err=True)
            sys.exit(2)
        except SimulationError as error:
            click.echo(f"failed: {error}", err=True)
            sys.exit(1)
        except OSError as error:
            click.echo(f"failed: {error.filename or 'a file'} can't be written ({error.strerror}); make room", err=True)
            sys.exit(1)
    finally:
        signal.signal(signal.SIGINT, previous)


@contextlib.contextmanager
def _importing() -> Iterator[None]:
    """Around imports: what they make stays, so that looking for garbage in it would be in vain, now and later."""
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():
            gc.freeze()
        gc.enable()


def _in_study(error: Exception, study: pathlib.Path | None) -> str:
    """The name of the study's file before what is wrong with the study."""
    from .study.places import StudyError

    return "" if study is None or not isinstance(error, StudyError) else f"{study.name}: "


def _load(command: str) -> types.ModuleType:
    """The module of a command, imported only now, so that help needs none of them."""
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
    remove_temporary()
    os._exit(130)


def _add(name: str, does: str, *parameters: click.Parameter) -> None:
    """A command of that name, whose module has `run`."""
    module, out = ROOMS.get(name, name), SEEN if name == "check" else OUT
    main.add_command(click.Command(name, None, functools.partial(_run, module), [*parameters, out], does))


for _name, _does, _given, *_options in (
    ("simulate", f"Runs the model on every trace of STUDY {SMALL}", KNOWN),
    ("fit", f"Calibrates the model to the traces of STUDY {SMALL}", START),
    ("check", f"Says what the traces of STUDY can tell, and which run to record next {SMALL}", DERIVED),
    ("compare", f"Fits other structures to STUDY and says which one its traces favour {SMALL}", START),
    (
        "recover",
        f"Simulates the campaigns of STUDY from known parameters, and fits them again {SMALL}",
        KNOWN,
        CAMPAIGNS,
    ),
    ("identify", f"Identifies part by part from STUDY, as its traces allow {SMALL}", START),
    ("control", f"Closes the loops of a controller with given gains: errors, effort, traces {FLEET}", KNOWN, GAINS),
    ("tune", f"Tunes a controller's gains by the gradient of its closed loops {FLEET}", CONTROLLED, *PROCESSES),
    ("tolerance", f"Simulates a population of actuators: spread, yield, envelopes {FLEET}", POPULATION, *PROCESSES),
    ("sensitivity", f"Ranks what the spread of a population comes from {FLEET}", POPULATION, *PROCESSES),
):
    _add(_name, _does, STUDY, click.Option(["--parameters"], type=PATH, metavar="FILE", help=_given), *_options)
_add(
    "flow",
    "Maps the flow through the nozzle of STUDY and its force on the rod (an assumed geometry if STUDY is omitted).",
    STUDY,
)
main.add_command(
    click.Command("export", None, functools.partial(_run, "export"), [RESULTS, FORMAT, DATE, FILE], EXPORT)
)
_add("reproduce", "Checks the numbers of the thesis's chapters 2 to 5 against this model.")
