"""Files of loggers that break one rule each, and the sentence that answers."""

import pathlib
import re

import pytest
from bad_recordings import SPOILT
from recorded import WRITERS, Campaign, campaign, sources_for

import vgtjax

BINARY = [name for name in WRITERS if name != "run.csv"]
KINDS = {"run.mf4": "MDF", "run.tdms": "TDMS", "run.mat": "MATLAB", "run_73.mat": "MATLAB", "run.parquet": "Parquet"}


def refusal(path: pathlib.Path, signals: Campaign | None = None) -> str:
    """What is said of a file from which the full model is to be fitted."""
    with pytest.raises(vgtjax.InputError) as error:
        vgtjax.load_trace(path, channels=sources_for(path, signals or campaign()), needs=("pwm", "x_d|p_act"))
    return str(error.value)


@pytest.mark.parametrize("rule", SPOILT)
@pytest.mark.parametrize("name", BINARY)
def test_a_spoilt_file_is_refused_in_one_sentence(tmp_path, name, rule):
    signals = SPOILT[rule].spoil(campaign())
    WRITERS[name](tmp_path / name, signals)
    assert refusal(tmp_path / name, signals) == SPOILT[rule].sentence(name)


@pytest.mark.parametrize("name", KINDS)
def test_an_empty_file(tmp_path, name):
    (tmp_path / name).touch()
    assert refusal(tmp_path / name) == f"{name}: the file is empty; export the trace again"


@pytest.mark.parametrize(("name", "kind"), KINDS.items())
def test_a_file_of_another_kind(tmp_path, name, kind):
    (tmp_path / name).write_bytes(bytes(range(256)))
    assert refusal(tmp_path / name) == (
        f"{name}: this is no {kind} file, although its name ends like one; export the trace again, or give the file "
        "the suffix of what it is"
    )


@pytest.mark.parametrize(("name", "kind"), KINDS.items())
def test_a_file_with_nothing_sensible_behind_its_beginning(tmp_path, name, kind):
    WRITERS[name](tmp_path / name, campaign())
    start = (tmp_path / name).read_bytes()[:128]
    (tmp_path / name).write_bytes(start + bytes(range(255, 0, -1)) * 40)
    assert re.fullmatch(
        rf"{name}: this {kind} file can't be read \(.+\); it is broken or incomplete, export the trace again",
        refusal(tmp_path / name),
    )


@pytest.mark.parametrize(("name", "kind"), KINDS.items())
def test_a_file_that_was_cut_off(tmp_path, name, kind):
    WRITERS[name](tmp_path / name, campaign())
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) * 2 // 3])
    end = "the file ends before its last segment does; export the trace again"
    broken = rf"this {kind} file can't be read \(.+\); it is broken or incomplete, export the trace again"
    assert re.fullmatch(rf"{name}: ({broken}|{end})", refusal(tmp_path / name))


def test_a_file_that_is_not_there(tmp_path):
    for name in WRITERS:
        assert refusal(tmp_path / name) == (
            f"{name}: can't be read (No such file or directory); check the path of the file"
        )
