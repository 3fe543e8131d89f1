"""What an installed package can do: without the extra `app`, and from a wheel, which has no evidence."""

import os
import pathlib
import shutil
import subprocess
import sys
import tomllib

import pytest

import calibrate.__main__ as entry
from calibrate import command_line

ROOT = pathlib.Path(entry.__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
BLOCKED = """
import runpy, sys
for name in {blocked}:
    sys.modules[name] = None  # as good as not installed
sys.argv = {argv}
{run}
"""


def blocked(*names: str, run: str = 'runpy.run_module("calibrate", run_name="__main__")', argv=("calibrate", "--help")):
    code = BLOCKED.format(blocked=names, run=run, argv=list(argv))
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, cwd=ROOT)


@pytest.mark.parametrize("run", [None, "from calibrate.__main__ import main; main()"], ids=["module", "script"])
def test_without_the_extra_one_sentence_says_what_to_install(run):
    outcome = blocked(*entry.EXTRA) if run is None else blocked(*entry.EXTRA, run=run)
    assert (outcome.returncode, outcome.stdout) == (2, "")
    assert outcome.stderr == (
        "error: the command line needs click, jinja2, platformdirs, plotly, pydantic, rich; "
        "install it by pip install 'vgtjax[app]'\n"
    )


def test_one_that_is_missing_is_named_before_anything_is_done(tmp_path):
    outcome = blocked("pydantic", argv=("calibrate", "fit", "--out", str(tmp_path / "out")))
    assert (outcome.returncode, outcome.stdout) == (2, "")
    assert outcome.stderr == "error: the command line needs pydantic; install it by pip install 'vgtjax[app]'\n"
    assert not (tmp_path / "out").exists()


def test_what_is_looked_for_is_what_the_extra_brings():
    declared = PROJECT["project"]["optional-dependencies"]["app"]
    assert tuple(name.partition(">")[0] for name in declared) == entry.EXTRA


# -- from a wheel ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> pathlib.Path:
    """A folder with the packages as the configuration of the wheel selects them."""
    chosen, folder = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"], tmp_path_factory.mktemp("wheel")
    left_out = {ROOT / path for path in chosen["exclude"]}
    assert all(path.exists() for path in left_out)

    def ignore(parent: str, names: list[str]) -> list[str]:
        return [name for name in names if pathlib.Path(parent, name) in left_out or name == "__pycache__"]

    for package in chosen["packages"]:
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    return folder


def run_wheel(wheel: pathlib.Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=wheel, env=environment)


def test_evidence_is_not_in_the_wheel_and_its_command_says_so(wheel):
    assert not (wheel / "calibrate" / "reproduction").exists()
    assert not (wheel / "calibrate" / "bench").exists()
    outcome = run_wheel(wheel, "-m", "calibrate", "reproduce", "--out", str(wheel / "out"))
    assert (outcome.returncode, outcome.stdout) == (2, "")
    assert outcome.stderr == (
        "error: this command needs a source checkout, but this is an installed package; run it in a clone\n"
    )
    assert not (wheel / "out").exists()


def test_no_other_command_needs_the_evidence(wheel):
    names = sorted(set(command_line.main.commands) - {"reproduce"})
    assert len(names) >= 6
    imports = "; ".join(f"import calibrate.{name}.command" for name in names)
    outcome = run_wheel(wheel, "-c", f"import calibrate; print(calibrate.__file__); {imports}")
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert outcome.stdout.startswith(str(wheel))
