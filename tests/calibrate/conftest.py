"""A folder with a good trace and a good study, to be spoilt."""

import pathlib
from collections.abc import Callable

import pytest
from bad_traces import text
from commands import Outcome, run_command

STUDY = '[[trace]]\nfile = "bench.csv"\n'


@pytest.fixture
def folder(tmp_path) -> pathlib.Path:
    (tmp_path / "bench.csv").write_text(text())
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


@pytest.fixture
def fit(folder) -> Callable[..., Outcome]:
    """Runs a fit of the study in the folder."""

    def fit(*arguments: object) -> Outcome:
        return run_command("fit", folder / "study.toml", "--out", folder / "out", *map(str, arguments))

    return fit
