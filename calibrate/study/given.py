"""What a command was told beside its study, for a report that says how to repeat it."""

import dataclasses
import pathlib
import shlex

import click

from .read import hash_file

NOT_REPEATED = ("study", "out", "process", "processes", "coordinator")
"""What a repetition names otherwise, and what no result depends on."""


@dataclasses.dataclass(frozen=True)
class Given:
    """One option as it is written, without the folder of a file, which has a `name` and a SHA-256 of its own."""

    words: str
    name: str
    sha256: str | None


def options_given() -> list[Given]:
    """All options of the command that runs, in its order; none where a library calls it."""
    context = click.get_current_context(silent=True)
    if context is None:
        return []
    stated = click.core.ParameterSource.COMMANDLINE
    options = [option for option in context.command.params if isinstance(option, click.Option) and option.name]
    return [
        _given(option.opts[0], context.params[str(option.name)])
        for option in options
        if option.name not in NOT_REPEATED and context.get_parameter_source(str(option.name)) is stated
    ]


def _given(option: str, value: object) -> Given:
    if not isinstance(value, pathlib.Path):
        return Given(f"{option} {value}", "", None)
    digest, name = hash_file(value) if value.is_file() else None, value.resolve().name
    return Given(f"{option} {shlex.quote(name)}", name, digest)
