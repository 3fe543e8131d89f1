"""What an installed package can do: without the extra `app`, and from a wheel, which has no evidence."""

import os
import pathlib
import subprocess
import sys
import tarfile
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
        "error: the command line needs click, jinja2, platformdirs, plotly, psutil, pydantic, rich; "
        "run pip install '.[app]' in a clone of vgtjax\n"
    )


def test_one_that_is_missing_is_named_before_anything_is_done(tmp_path):
    outcome = blocked("pydantic", argv=("calibrate", "fit", "--out", str(tmp_path / "out")))
    assert (outcome.returncode, outcome.stdout) == (2, "")
    assert outcome.stderr == "error: the command line needs pydantic; run pip install '.[app]' in a clone of vgtjax\n"
    assert not (tmp_path / "out").exists()


def test_what_is_looked_for_is_what_the_extra_brings():
    declared = PROJECT["project"]["optional-dependencies"]["app"]
    assert tuple(name.partition(">")[0] for name in declared) == entry.EXTRA


# -- from a wheel ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> pathlib.Path:
    """A folder with the sdist of this checkout, and the wheel that is built from that, as for a release."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    outcome = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    return folder


@pytest.fixture(scope="module")
def wheel(built, tmp_path_factory) -> pathlib.Path:
    """A folder where pip has installed the wheel, without what it depends on."""
    (file,), folder = built.glob("*.whl"), tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--target", folder, file]
    outcome = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=120)
    assert outcome.returncode == 0, outcome.stderr
    return folder


def run_wheel(wheel: pathlib.Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=wheel, env=environment)


def test_a_release_is_whole_and_has_one_version(built, wheel):
    (source,), (file,) = built.glob("*.tar.gz"), built.glob("*.whl")
    version = source.name.removeprefix("vgtjax-").removesuffix(".tar.gz")
    assert file.name == f"vgtjax-{version}-py3-none-any.whl"
    with tarfile.open(source) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    # What a stranger needs to check it: tests with their data, the manual, the licence, how to cite it.
    assert {"tests/conftest.py", "docs/physics.md", "notebooks/first_steps.ipynb", "LICENSE", "CITATION.cff"} <= inside
    assert not [name for name in inside if name.startswith((".ci", "out/", "build/", ".venv"))]
    outcome = run_wheel(wheel, "-c", "import vgtjax; print(vgtjax.__version__)")
    assert (outcome.stdout.strip(), outcome.stderr) == (version, "")
    assert (wheel / "vgtjax" / "py.typed").exists()


def test_the_wheel_simulates_and_writes_below_out_only(wheel, tmp_path):
    study, out, home = tmp_path / "study", tmp_path / "results", tmp_path / "home"
    study.mkdir()
    (study / "study.toml").write_text('name = "a"\n[[trace]]\nfile = "a.csv"\n', encoding="utf-8")
    rows = "".join(f"{0.01 * i:.2f},40,200,900,5\n" for i in range(20))
    header = "time [s],pwm [%],p_res [mbar absolute],p_act [mbar absolute],x_d [mm]\n"
    (study / "a.csv").write_text(header + rows, encoding="utf-8")
    before = {path: path.stat().st_mtime_ns for path in wheel.rglob("*") if "__pycache__" not in path.parts}
    environment = {**os.environ, "PYTHONPATH": str(wheel), "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}
    command = [sys.executable, "-m", "calibrate", "simulate", str(study / "study.toml"), "--out", str(out)]
    outcome = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=study, env=environment)
    assert outcome.returncode == 0, outcome.stderr
    assert (out / "a.csv").exists()
    # Beside the results only the cache of compiled programs, where the system keeps caches.
    assert {path.name for path in tmp_path.iterdir()} == {"study", "results", "home"}
    assert {path.name for path in study.iterdir()} == {"study.toml", "a.csv"}
    assert [path.name for path in home.iterdir()] == ["cache"]
    assert before == {path: path.stat().st_mtime_ns for path in wheel.rglob("*") if "__pycache__" not in path.parts}


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
    imports = "; ".join(f"import calibrate.{command_line.ROOMS.get(name, name)}.command" for name in names)
    outcome = run_wheel(wheel, "-c", f"import calibrate; print(calibrate.__file__); {imports}")
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert outcome.stdout.startswith(str(wheel))
