"""`.ci/pythons` runs every supported Python, and says which of them it has not seen."""

import os
import pathlib
import shutil
import subprocess
import tomllib

import pytest
from markdown_pages import ROOT

SCRIPT = ROOT / ".ci" / "pythons"
STUB = """#!{bash}
case "$*" in
  "-m venv "*) mkdir -p "$3/bin"; cp "$0" "$3/bin/python" ;;
  *"{failing}"*) exit 1 ;;
esac
"""
"""An interpreter that makes an environment of itself, and does nothing else."""
TOOLS = ("bash", "env", "dirname", "mktemp", "rm", "mkdir", "cp")

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="a source distribution is without it")


def run(
    folder: pathlib.Path, *versions: str, asked: str = "", failing: str = "nothing fails", newest: str = ""
) -> tuple[int, str]:
    """Status and last line where those versions are installed."""
    for tool in TOOLS:
        (folder / tool).symlink_to(shutil.which(tool))
    for version in versions:
        stub = folder / f"python{version}"
        stub.write_text(STUB.format(bash=shutil.which("bash"), failing=failing))
        stub.chmod(0o755)
    environment = {"PATH": str(folder), "TMPDIR": os.environ.get("TMPDIR", "/tmp"), "PYTHONS": asked, "NEWEST": newest}
    done = subprocess.run([str(SCRIPT)], env=environment, capture_output=True, text=True)
    return done.returncode, (done.stdout.splitlines() or [""])[-1]


def test_all_supported_pythons_pass(tmp_path):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    versions = [each.rpartition(" ")[2] for each in project["classifiers"] if "Python :: 3." in each]
    assert run(tmp_path, *versions) == (0, f"passed: {' '.join(versions)}; not here: none")


def test_one_that_is_not_here_is_named_and_no_success(tmp_path):
    assert run(tmp_path, "3.11") == (1, "passed: 3.11; not here: 3.12 3.13")


def test_no_python_at_all_is_no_success(tmp_path):
    assert run(tmp_path) == (1, "passed: none; not here: 3.11 3.12 3.13")


def test_a_subset_that_is_asked_for_is_enough(tmp_path):
    line = "passed: 3.12; not here: none; asked for: 3.12 of 3.11 3.12 3.13"
    assert run(tmp_path, "3.12", asked="3.12") == (0, line)


@pytest.mark.parametrize(("newest", "status"), [("", 1), ("1", 0)])
def test_the_newest_versions_are_without_the_constraints(tmp_path, newest, status):
    assert run(tmp_path, "3.11", "3.12", "3.13", failing="-c constraints.txt", newest=newest)[0] == status


@pytest.mark.parametrize("step", ["-m pip", "-m pytest", "-m calibrate"])
def test_a_step_that_fails_is_no_success(tmp_path, step):
    status, line = run(tmp_path, "3.11", "3.12", "3.13", failing=step)
    assert (status, line) == (1, "+ python3.11")
