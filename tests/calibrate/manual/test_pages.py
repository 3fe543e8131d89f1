"""Every block of README and manual: studies are studies, commands are commands, Python runs."""

import re
import tomllib

import numpy as np
import pytest
from markdown_pages import DOCS, PAGES, README, ROOT, name_of
from python_blocks import RUN_BY, python_block

import vgtjax
import vgtjax.traces.files._open as readers
from calibrate.bench.__main__ import _CASES as benchmarks
from calibrate.command_line import main
from calibrate.manual.markdown import FENCE, blocks, commands
from calibrate.study.components import CHAMBER, FRICTION, LINE, MAGNETIC_FORCE, VANE_FORCE
from calibrate.study.models import build_model, start_values
from calibrate.study.references import build_references
from calibrate.study.tables import AnyStudy
from calibrate.tune.designs import DESIGNS

STUDIES = [(page, text) for page in PAGES for text in blocks(page, "toml")]
COMMANDS = [(page, words) for page in PAGES for words in commands(page) if words[:3] == ["python", "-m", "calibrate"]]
OTHERS = [(page, words) for page in PAGES for words in commands(page) if words[:3] != ["python", "-m", "calibrate"]]


def shown(given) -> str:
    """A page by its path, a command by its words, a study by its first line."""
    if isinstance(given, list):
        return " ".join(given[:9])
    return given.splitlines()[0] if isinstance(given, str) else name_of(given)


WITHOUT_STUDY = {"flow", "reproduce", "export"}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_says_what_it_is(page):
    # Blocks of text show what a terminal says; all others are run or read by the tests of this file and its neighbours.
    found = {language for language, _ in FENCE.findall(page.read_text(encoding="utf-8"))}
    assert found <= {"python", "toml", "bash", "text", "csv"}
    assert page.read_text(encoding="utf-8").count("\n```") % 2 == 0


@pytest.mark.parametrize(("page", "text"), STUDIES, ids=shown)
def test_studies_are_studies(page, text):
    study = AnyStudy.validate_python({"trace": [{"file": "any.csv"}]} | tomllib.loads(text))
    model = build_model(study)
    values, _ = start_values(model, study.parameters)
    assert set(values) == {name for name, given in study.parameters.items() if given.value is not None}
    assert vgtjax.select(model, study.fit.free, study.fit.fixed).entries
    controller = DESIGNS[study.control.design].for_plant(vgtjax.Actuator())
    assert vgtjax.select(controller, free=study.control.free).entries
    assert set(start_values(controller, study.control.gains)[0]) == set(study.control.gains)
    assert build_references(study.control.reference, ROOT, study.channels)


@pytest.mark.parametrize(("page", "words"), COMMANDS, ids=shown)
def test_commands_have_the_options_that_are_shown(page, words):
    name, *given = [word for word in words[3:] if word != "&"]
    context = main.commands[name].make_context(name, given)
    assert context.params.get("study") is not None or name in WITHOUT_STUDY


@pytest.mark.parametrize(("page", "words"), OTHERS, ids=shown)
def test_what_else_a_shell_is_told(page, words):
    """CI runs the README's two lines; the others install an extra, write a study, or copy the example."""
    match words:
        case ["python3", *_]:
            assert page == README
            for part in " ".join(words).split(" && "):
                _, _, given = part.partition("-m calibrate ")
                if given:
                    name, *options = given.split()
                    assert main.commands[name].make_context(name, options).params["out"]
        case ["pip", "install", package]:
            assert set(re.findall(r"[a-z]+", package.partition("[")[2])) <= extras()
        case ["printf", text, ">", _]:
            assert AnyStudy.validate_python(tomllib.loads(text.replace("\\n", "\n")))
        case ["cp", "-r", source, "campaign"]:
            assert (ROOT / source / "study.toml").is_file()
        case _:
            assert words == ["cat", ">", "study.toml"]  # what it writes is read below


def extras() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return set(project["optional-dependencies"])


def test_a_study_in_a_shell_is_a_study():
    (text,) = re.findall(
        r"<< 'END'\n(.*?)^END$", (DOCS / "files.md").read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    study = AnyStudy.validate_python(tomllib.loads(text))
    assert set(study.channels) == {"pwm", "p_act", "p_res", "x_d"}


def listed(beginning: str) -> str:
    """The block of the page on studies that begins like that."""
    return next(text for text in blocks(DOCS / "study_file.md", "toml") if beginning in text)


@pytest.mark.parametrize("registry", [FRICTION, VANE_FORCE, LINE, MAGNETIC_FORCE, CHAMBER])
def test_every_component_is_named(registry):
    for name in registry:
        assert re.search(rf"\b{name}\b", listed('[components]\nfriction = "lugre"')), name


def test_every_design_is_named():
    for name in DESIGNS:
        assert re.search(rf"\b{name}\b", listed("[control]")), name


PYTHON = [(page, text) for page in PAGES for text in blocks(page, "python")]


@pytest.mark.parametrize(("page", "text"), PYTHON, ids=shown)
def test_every_python_block_is_run(page, text):
    (key,) = [(at, name) for at, name in RUN_BY if at == name_of(page) and name in text]
    file, _, test = RUN_BY[key].partition("::")
    source = (ROOT / "tests" / file).read_text(encoding="utf-8")
    assert f'python_block("{key[0]}", "{key[1]}")' in source
    assert f"def {test}(" in source


def test_no_block_is_said_to_be_run_that_is_gone():
    assert len(RUN_BY) == len(PYTHON)


@pytest.fixture
def executed(monkeypatch):
    """Runs a block where its files are, and gives its names."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(vgtjax, "configure", lambda: None)  # the session is configured already

    def run(text: str) -> dict:
        scope: dict = {}
        exec(text, scope)
        return scope

    return run


def test_a_first_simulation_runs(executed):
    scope = executed(python_block("docs/python.md", "vgtjax.jacobian"))
    assert scope["solution"].x_d.shape == scope["trace"].time.shape
    assert scope["slopes"].shape == (len(scope["trace"].time), 2, 8)


def test_closed_loops_run(executed):
    scope = executed(python_block("docs/python.md", "close_loops"))
    known, stiffer = scope["loops"].pressure_rms
    assert not scope["loops"].failed.any()
    # What is wrong with the believed spring is taken for pressure: 5 N over the diaphragm's area are 1.7 kPa.
    assert known < 0.5 * stiffer


def test_a_series_runs(executed):
    scope = executed(python_block("docs/tutorials/study.md", "spread_population"))
    assert scope["widths"].shape == (64,)
    assert scope["kept"].share == np.mean(scope["widths"] <= 3000.0)
    assert not scope["results"].failed.any()


def test_a_friction_law_of_ones_own_takes_part(executed):
    scope = executed(python_block("docs/extending.md", "class Drag"))
    assert {"friction.viscous_damping", "friction.quadratic_damping"} <= set(vgtjax.parameter_table(scope["actuator"]))
    assert np.all(np.any(scope["slopes"] != 0, axis=(0, 1)))


def test_a_trace_is_made_of_arrays(executed):
    scope = executed(python_block("docs/extending.md", "vgtjax.Trace("))
    assert scope["trace"].pwm[-1] == 80.0


def test_extensions_are_as_short_as_their_page_says():
    texts = [*blocks(DOCS / "extending.md", "python"), python_block("docs/control.md", "class Follower")]
    assert len(texts) == 4
    for text in texts:
        assert sum(bool(line.strip()) for line in text.splitlines()) <= 20, text.splitlines()[0]


def test_a_file_format_of_ones_own_is_read(monkeypatch, tmp_path):
    monkeypatch.setattr(readers, "READERS", dict(readers.READERS))  # what is registered here is forgotten after it
    exec(python_block("docs/extending.md", "NPZRecording"), {})
    time = np.arange(0.0, 0.5, 1e-3)
    np.savez(tmp_path / "run.npz", **{"time [s]": time, "pwm [%]": 50 + time, "x_d [mm]": time})
    trace = vgtjax.load_trace(tmp_path / "run.npz")
    np.testing.assert_allclose(trace.x_d, 1e-3 * time, rtol=1e-15)
    (tmp_path / "broken.npz").write_bytes(b"PK no archive")
    with pytest.raises(vgtjax.InputError, match=r"broken.npz: this NumPy archive file can't be read"):
        vgtjax.load_trace(tmp_path / "broken.npz")


def test_benchmarks_that_pages_name_are_there():
    text = "\n".join(" ".join(page.read_text(encoding="utf-8").split()) for page in PAGES)
    named = set(re.findall(r"calibrate\.bench --only ([\w-]+)", text))
    assert len(named) > 10
    assert named <= set(benchmarks)
