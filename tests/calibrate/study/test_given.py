"""A report says with which options its command ran: names and digests of files, no folder of anybody's machine."""

import hashlib
import pathlib

import click
import click.testing

from calibrate.study.given import Given, options_given

PATH = click.Path(path_type=pathlib.Path)


def given_to(*arguments: str) -> list[Given]:
    """What a command with such arguments was told."""
    found: list[Given] = []

    @click.command()
    @click.argument("study", type=PATH)
    @click.option("--parameters", type=PATH)
    @click.option("--campaigns", type=int, default=64)
    @click.option("--process", type=int)
    @click.option("--out", type=PATH)
    def command(**_: object) -> None:
        found.extend(options_given())

    outcome = click.testing.CliRunner().invoke(command, arguments)
    assert outcome.exit_code == 0, outcome.output
    return found


def test_files_have_a_digest_and_folders_none(tmp_path):
    file = tmp_path / "parameters.json"
    file.write_bytes(b"{}")
    digest = hashlib.sha256(b"{}").hexdigest()
    out = ("study.toml", "--out", "results")
    assert given_to(*out, "--parameters", str(file)) == [
        Given("--parameters parameters.json", "parameters.json", digest)
    ]
    spaced = tmp_path / "unit a.json"
    spaced.write_bytes(b"{}")
    assert given_to(*out, "--parameters", str(spaced))[0].words == "--parameters 'unit a.json'"
    assert given_to(*out, "--parameters", str(tmp_path / "."))[0].name == tmp_path.name
    assert given_to(*out, "--parameters", str(tmp_path)) == [
        Given(f"--parameters {tmp_path.name}", tmp_path.name, None)
    ]


def test_only_what_was_stated_and_matters():
    assert given_to("study.toml", "--out", "results", "--process", "1") == []
    assert given_to("study.toml", "--campaigns", "8") == [Given("--campaigns 8", "", None)]


def test_a_library_was_told_nothing():
    assert options_given() == []
