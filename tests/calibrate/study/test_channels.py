"""Files of loggers in a study: their channels, their hashes, and one sentence with status 2 for a bad one."""

import hashlib
import sys

import numpy as np
import pytest
from bad_recordings import SPOILT
from commands import assert_refused, run_command
from recorded import UNITS, WRITERS, campaign, write_mdf, write_tdms

import vgtjax
from calibrate.study import prepare

BINARY = [name for name in WRITERS if name != "run.csv"]


def channels_of(signals, table: str = "channels") -> str:
    """The map that a file without units needs, as a study states it."""
    stated = [(name, signal.unit) for name, signal in signals.items() if signal.unit is not None]
    return "".join(f'[{table}.{name}]\nunit = "{unit}"\n' for name, unit in stated)


def study_of(name: str, signals) -> str:
    return f'[[trace]]\nfile = "{name}"\n' + (channels_of(signals) if name.endswith(".mat") else "")


def prepared(folder, text: str):
    (folder / "study.toml").write_text(text)
    return prepare(folder / "study.toml", None, to_fit=True)


def test_the_units_of_a_study_are_the_same_whatever_its_files(tmp_path):
    WRITERS["run.csv"](tmp_path / "run.csv", campaign())
    reference = prepared(tmp_path, study_of("run.csv", campaign())).units[0]
    for name in BINARY:
        WRITERS[name](tmp_path / name, campaign())
        unit = prepared(tmp_path, study_of(name, campaign()).replace("file", 'name = "run"\nfile')).units[0]
        assert (unit.bounds, unit.known, unit.stated) == (reference.bounds, reference.known, reference.stated)
        ((use, trace),) = unit.traces
        assert (use, trace.name, trace.notes) == ("fit", "run", ())
        for channel in UNITS:  # the last bits of text and counts differ
            expected = reference.traces[0][1].channels[channel]
            np.testing.assert_allclose(trace.channels[channel].value, expected.value, rtol=1e-12, atol=1e-15)
            np.testing.assert_allclose(trace.channels[channel].time, expected.time, rtol=1e-12, atol=1e-15)
        assert unit.hashes == {"run": hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()}


def test_files_of_several_kinds_share_a_study(tmp_path):
    write_mdf(tmp_path / "run_1.mf4", campaign())
    write_tdms(tmp_path / "run_2.tdms", campaign(slow=5))
    WRITERS["run.csv"](tmp_path / "run_3.csv", campaign())
    (unit,) = prepared(tmp_path, '[[trace]]\nfile = "run_*"\n').units
    assert [trace.name for _, trace in unit.traces] == ["run_1", "run_2", "run_3"]
    assert [trace.has_common_clock for _, trace in unit.traces] == [True, False, True]


def test_a_trace_overrides_the_channels_of_its_study_key_by_key(tmp_path):
    signals = campaign()
    write_mdf(tmp_path / "a.mf4", {"pwm": signals["pwm"], "Pos": signals["x_d"]})
    write_mdf(tmp_path / "b.mf4", {"pwm": signals["pwm"], "Pos": signals["x_d"]})
    general = '[channels.x_d]\nname = "Pos"\nunit = "um"\nscale = 1000.0\n'
    own = '[[trace]]\nfile = "a.mf4"\n[[trace]]\nfile = "b.mf4"\n[trace.channels.x_d]\nscale = 500.0\n'
    (unit,) = prepared(tmp_path, general + own).units
    (_, first), (_, second) = unit.traces
    np.testing.assert_allclose(first.x_d, signals["x_d"].value * 1e-3, rtol=1e-12)
    np.testing.assert_allclose(second.x_d, 0.5 * first.x_d, rtol=1e-12)


def test_another_map_is_another_study(tmp_path):
    write_mdf(tmp_path / "run.mf4", campaign())
    text = study_of("run.mf4", campaign())
    fingerprints = {prepared(tmp_path, text).fingerprint}
    fingerprints.add(prepared(tmp_path, text + "[channels.x_d]\noffset = 0.01\n").fingerprint)
    fingerprints.add(prepared(tmp_path, text + "[trace.channels.x_d]\noffset = 0.01\n").fingerprint)
    assert len(fingerprints) == 3


@pytest.mark.parametrize("rule", SPOILT)
@pytest.mark.parametrize("name", BINARY)
def test_a_fit_refuses_a_spoilt_file(tmp_path, name, rule):
    signals = SPOILT[rule].spoil(campaign())
    WRITERS[name](tmp_path / name, signals)
    (tmp_path / "study.toml").write_text(study_of(name, signals))
    outcome = run_command("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert_refused(outcome, SPOILT[rule].sentence(name), tmp_path / "out")


@pytest.mark.parametrize("name", BINARY)
@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 8])
def test_a_fit_refuses_an_empty_or_another_file(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    (tmp_path / "study.toml").write_text(study_of(name, campaign()))
    outcome = run_command("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert (outcome.status, outcome.out) == (2, "")
    what = "although its name ends like one" if content else "the file is empty; export the trace again"
    assert what in outcome.err
    assert outcome.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_missing_extra_ends_with_status_2_and_its_command(tmp_path, monkeypatch):
    write_mdf(tmp_path / "run.mf4", campaign())
    (tmp_path / "study.toml").write_text(study_of("run.mf4", campaign()))
    monkeypatch.setitem(sys.modules, "asammdf", None)
    sentence = (
        "run.mf4: this file is read by the package asammdf, which is not installed; run pip install '.[mdf]' in a "
        "clone of vgtjax"
    )
    assert_refused(run_command("fit", tmp_path / "study.toml", "--out", tmp_path / "out"), sentence, tmp_path / "out")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            '[channels.p_atc]\nname = "P"\n',
            "a key of channels must be one of time, pwm, p_act, p_res, p_trb, x_d, f_vane, f_drive, but it is 'p_atc'; "
            "did you mean 'p_act'?",
        ),
        ('[channels.p_act]\nnme = "P"\n', "unknown key 'channels.p_act.nme'; did you mean 'name'?"),
        (
            '[channels]\np_act = "P"\n',
            "'channels.p_act' must be a table, but it is 'P'; write e.g. {name = 'P'}",
        ),
        (
            "[channels.p_act]\nscale = 0.0\n",
            "the scale of a channel must not be zero, but it is; remove it or correct it",
        ),
        (
            '[[trace]]\nfile = "run.mf4"\n[trace.channels.p_act]\nunti = "P"\n',
            "unknown key 'trace.channels.p_act.unti'; did you mean 'unit'?",
        ),
    ],
)
def test_a_bad_map_is_one_sentence(tmp_path, text, sentence):
    with pytest.raises(vgtjax.InputError) as error:
        prepared(tmp_path, text)
    assert str(error.value) == f"study.toml: {sentence}"


def test_a_file_that_is_not_there_is_likened_to_those_of_every_kind(tmp_path):
    write_mdf(tmp_path / "step_80.mf4", campaign())
    with pytest.raises(vgtjax.InputError, match=r"'step_8\.mf4' matches nothing in .*; did you mean 'step_80\.mf4'\?"):
        prepared(tmp_path, '[[trace]]\nfile = "step_8.mf4"\n')


def test_an_infinite_value_is_another_study_than_none(tmp_path):
    """JSON has neither, and both would be null."""
    write_mdf(tmp_path / "run.mf4", campaign())
    text = study_of("run.mf4", campaign())
    given = ("{value = inf}", "{}")
    assert (
        len({prepared(tmp_path, f'{text}[parameters]\n"diaphragm.travel" = {each}\n').fingerprint for each in given})
        == 2
    )
