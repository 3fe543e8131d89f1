"""The commands of README and manual, as they stand there, on small studies; what takes minutes, other tests run.

Those of the README all run here, one after the other, on the studies that it prints, made small.
"""

import contextlib
import pathlib
import shutil
import tomllib

import pytest
from commands import Outcome, run_command
from markdown_pages import PAGES, README, ROOT

from calibrate.manual.markdown import commands

SMALL = ("fit", "simulate", "export")
"""Commands that are run here, in this order: what one writes the next may read."""
ELSEWHERE = {
    "check": "calibrate/assurance/test_check.py",
    "compare": "calibrate/compare/test_compare.py",
    "control": "calibrate/control/test_control.py",
    "flow": "calibrate/flow/test_flow_command.py",
    "identify": "calibrate/identify/test_identify.py",
    "recover": "calibrate/assurance/test_recover.py",
    "reproduce": "calibrate/reproduction/test_reproduction.py",
    "sensitivity": "calibrate/sensitivity/test_sensitivity.py",
    "tolerance": "calibrate/tolerance/test_tolerance.py",
    "tune": "calibrate/tune/test_tune.py",
}
"""Commands that take longer, with the tests that run them."""
EXAMPLES = "calibrate/example"
"""What is said of the examples themselves is run by tests/calibrate/study/test_example_recordings.py and by CI."""
MADE_SMALL = {
    # What tests/calibrate/conftest.py fits, to the same trace: the programs are those that it has compiled.
    "campaign/study.toml": "[fit]\nfree = {free}\n",
    "series.toml": "[tolerance]\nsamples = 8\n[experiments]\nloop_seconds = 2.0\nsteps = []\n",
    "controller.toml": """
plants = 1
duration = 0.3
settled = 0.1
period = 2e-3
reference = [{kind = "sine", amplitude = 0.001, rate = 12.0, offset = 0.005}]
[control.unseen]
plants = 0
reference = [{kind = "sine", name = "slower", amplitude = 0.001, rate = 6.0, offset = 0.005}]
""",
}
"""What is added to the studies that the README prints."""


def printed_studies() -> dict[str, str]:
    """The studies that the README has a shell write."""
    shown = [words for words in commands(README) if words[0] == "printf"]
    return {path: text.replace("\\n", "\n") for _, text, _, path in shown}


def of_readme() -> list[list[str]]:
    """Its commands, in the order of its jobs."""
    return [words[3:] for words in commands(README) if words[:3] == ["python", "-m", "calibrate"]]


def runs() -> list[list[str]]:
    """Each command that is shown, once with the same options, without those that are run elsewhere."""
    others = [words for words in _small_ones() if words not in of_readme()]
    return [*of_readme(), *others]


def _small_ones() -> list[list[str]]:
    shown = [words[3:] for page in PAGES for words in commands(page) if words[:3] == ["python", "-m", "calibrate"]]
    small = [words for words in shown if words[0] in SMALL and not any(EXAMPLES in word for word in words)]
    alone = [words for words in small if "fmu" not in words]  # tests/calibrate/fmu
    by_kind = {(words[0], *[word for word in words if word[:2] == "--"]): words for words in alone}
    return sorted(by_kind.values(), key=lambda words: SMALL.index(words[0]))


@pytest.fixture(scope="module")
def desk(tmp_path_factory, fitted) -> pathlib.Path:
    """A folder with small studies under the names that the manual gives them."""
    folder = tmp_path_factory.mktemp("desk")
    shutil.copytree(fitted.study.parent, folder, ignore=shutil.ignore_patterns("out"), dirs_exist_ok=True)
    (folder / "campaign").mkdir()
    shutil.copy(folder / "step_80.csv", folder / "campaign")
    free = tomllib.loads(fitted.study.read_text(encoding="utf-8"))["fit"]["free"]
    for path, text in printed_studies().items():
        (folder / path).write_text(text + MADE_SMALL[path].replace("{free}", str(free)), encoding="utf-8")
    shutil.copytree(fitted.out, folder / "results" / "a_start")
    return folder


@pytest.fixture(scope="module")
def outcomes(desk) -> dict[tuple[str, ...], Outcome]:
    """What each command said, all of them in one folder as in a reader's."""
    found = {}
    with contextlib.chdir(desk):
        for words in runs():
            if words[0] == "fit":  # another study in the same folder would be refused
                shutil.rmtree(words[words.index("--out") + 1], ignore_errors=True)
            found[tuple(words)] = run_command(*words)
    return found


@pytest.mark.parametrize("words", runs(), ids=" ".join)
def test_a_command_of_the_manual_runs(outcomes, words):
    outcome = outcomes[tuple(words)]
    assert (outcome.status, outcome.err) == (0, "")


@pytest.mark.parametrize("command", ELSEWHERE)
def test_a_long_command_is_run_elsewhere(command):
    text = (ROOT / "tests" / ELSEWHERE[command]).read_text(encoding="utf-8")
    assert f'run_command("{command}"' in text


def test_each_command_is_run_somewhere():
    shown = {words[3] for page in PAGES for words in commands(page) if words[:3] == ["python", "-m", "calibrate"]}
    assert shown == {*SMALL, *ELSEWHERE}
