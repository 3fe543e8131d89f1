"""A folder with a good trace and a good study, to be spoilt; and a small fit that many tests look at."""

import contextlib
import dataclasses
import pathlib
from collections.abc import Callable, Iterator

import jaxtyping
import pytest
from bad_traces import text
from commands import NOTHING_ELSE, Outcome, cut_example, run_command
from support import kept_programs

STUDY = '[[trace]]\nfile = "bench.csv"\n'


@contextlib.contextmanager
def annotations_as_they_are() -> Iterator[None]:
    """The library's annotations are checked where it is tested; here that would take a tenth of the time."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


@pytest.fixture(scope="module", autouse=True)
def _annotations_as_they_are() -> Iterator[None]:
    with annotations_as_they_are():
        yield


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


FREE = ("converter.magnetic_force[2]", "diaphragm.preload", "diaphragm.stiffness", "friction.viscous_damping")
SMALL_STUDY = f"""name = "small & quick"
data = "simulated <here>"

[[trace]]
file = "step_80.csv"

[[trace]]
file = "step_50.csv"
use = "validate"
atmosphere = 101100

[fit]
free = {list(FREE)}

[parameters]
"diaphragm.stiffness" = {{value = 11500, lower = 8000, upper = 16000}}
"""


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A study, the folder that a fit of it wrote, and what the user saw."""

    study: pathlib.Path
    out: pathlib.Path
    outcome: Outcome


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Iterator[None]:
    """For files that fit the small study and replace nothing of it."""
    with kept_programs(tmp_path_factory):
        yield


@pytest.fixture(scope="session")
def fitted(tmp_path_factory) -> Fitted:
    """A small study, fitted: four parameters to the first 1.2 s of a step."""
    folder = tmp_path_factory.mktemp("small")
    for name in ("step_80", "step_50"):
        cut_example(name, 1.2, folder)
    (folder / "study.toml").write_text(SMALL_STUDY)
    # A fixture of a session comes before those of its modules.
    with annotations_as_they_are(), kept_programs(tmp_path_factory):
        outcome = run_command("fit", folder / "study.toml", "--out", folder / "out")
    return Fitted(folder / "study.toml", folder / "out", outcome)


@pytest.fixture
def small(fitted, tmp_path) -> pathlib.Path:
    """A copy of the small study and its traces, not fitted yet."""
    for path in (fitted.study, *fitted.study.parent.glob("*.csv")):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path / "study.toml"


@pytest.fixture
def plain(small) -> pathlib.Path:
    """The small study which looks for no more than its parameters, for what the rest has no say in."""
    small.write_text(small.read_text().replace("\n[parameters]", f"{NOTHING_ELSE}\n[parameters]"))
    return small
