"""Running the command line inside the process of the tests, whose JAX is set up already."""

import contextlib
import dataclasses
import io
import json
import pathlib
import re
from typing import Any
from unittest import mock

import calibrate.command_line as command_line

NOTHING_ELSE = """
[fit.unknown]
duty_delay = false
duty_hold = false
noise = "white"
numerics = false
"""
"""For a fit that looks for no more than its parameters, as what it finds out of sensors and duty takes most of it."""


UNSEEN = ["diaphragm.stiffness", "diaphragm.damping", "friction.viscous_damping", "converter.atmosphere_orifice"]
"""Free parameters of which the small study's traces tell the first: only the sum of the dampings acts, and the orifice
stays shut. The same ones wherever some are to be undetermined, as each selection is a set of programs."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a user sees of a command."""

    status: int
    out: str
    err: str


def run_command(*arguments: str | pathlib.Path) -> Outcome:
    """`python -m calibrate ARGUMENTS`, without another process."""
    out, err, status = io.StringIO(), io.StringIO(), 0
    with (
        mock.patch.object(command_line, "_prepare_jax"),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            command_line.main([str(argument) for argument in arguments], prog_name="python -m calibrate")
        except SystemExit as end:
            status = int(end.code or 0)
    return Outcome(status, out.getvalue(), err.getvalue())


def read(path: pathlib.Path) -> Any:
    """The content of a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))


def timeless(report: pathlib.Path) -> str:
    """A report without its date, and without the seconds that its command took."""
    text, summary = report.read_text(encoding="utf-8"), read(report.parent / "summary.json")
    for each in summary.get("units", {}).values():
        steps = f"<td>{each['iterations']}</td>"  # the cell before, or another figure that looks the same would go
        text = text.replace(f"{steps}<td>{each['wall_seconds']:.3g}</td>", f"{steps}<td>some</td>")
    text = re.sub(r" in [\d.e+-]+ s\b", " in some s", text)
    return re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d \w+", "date", text)


def entries_of(parameters: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The fields of `parameters.json` by entry, arrays taken apart."""
    found = {}
    for name, fields in parameters.items():
        if isinstance(fields["value"], list):
            for index in range(len(fields["value"])):
                each = {key: field[index] for key, field in fields.items()}
                found[f"{name}[{index}]"] = each
        else:
            found[name] = fields
    return found


def cut_example(name: str, seconds: float, folder: pathlib.Path, new_name: str | None = None) -> None:
    """The first seconds of a trace that ships, as `folder/NEW_NAME.csv`."""
    example = pathlib.Path(command_line.__file__).parent / "example" / f"{name}.csv"
    lines = example.read_text(encoding="utf-8").splitlines()[: round(seconds * 1000) + 2]
    (folder / f"{new_name or name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def assert_refused(outcome: Outcome, sentence: str, out: pathlib.Path) -> None:
    """Bad input: one line that says so, exit status 2, and nothing written."""
    assert outcome == Outcome(2, "", f"error: {sentence}\n")
    assert not out.exists()
