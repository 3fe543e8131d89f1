"""Files of loggers that break one rule each, and the sentence that answers."""

import pathlib
import random
import re
import struct
import zlib

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import scipy.io
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


def test_a_time_that_is_missing_is_counted_as_every_row_is(tmp_path):
    times = [None if row == 3 else row * 1e-3 for row in range(41)]
    table = pyarrow.table({"time [s]": times, "pwm [%]": np.zeros(41), "x_d [mm]": np.zeros(41)})
    pyarrow.parquet.write_table(table, tmp_path / "run.parquet")
    assert refusal(tmp_path / "run.parquet") == (
        "run.parquet, column time, row 4: every time must be there, but this one is missing; remove the row"
    )


# -- files that would end the process, in C of scipy and asammdf -------------------------------------------------------

TIME = np.arange(41) * 1e-3


def spoilt(content: bytes, seed: int) -> bytes:
    """Some bytes, words or all from a place on are random, behind what says which kind of file it is."""
    rng, data = random.Random(seed), bytearray(content)
    begin = rng.randrange(128, len(data) - 8)
    end = rng.choice([begin + 1, begin + 4, begin + 400, len(data)])
    data[begin:end] = rng.randbytes(len(data[begin:end]))
    return bytes(data)


@pytest.mark.parametrize(("name", "count"), [(name, 150 if name == "run.mat" else 15) for name in BINARY])
def test_random_bytes_are_a_trace_or_one_sentence(tmp_path, name, count):
    WRITERS[name](tmp_path / name, campaign())
    whole, said = (tmp_path / name).read_bytes(), []
    for seed in range(count):
        (tmp_path / name).write_bytes(spoilt(whole, seed))
        try:
            vgtjax.load_trace(tmp_path / name, channels=sources_for(tmp_path / name, campaign()))
        except vgtjax.InputError as error:
            said.append(str(error))
    assert all(sentence.startswith(name) and "\n" not in sentence for sentence in said)
    assert len(said) > count // 4


def variable(content: dict, tmp_path: pathlib.Path, **options) -> bytes:
    """A variable of a MAT-file, behind the header."""
    scipy.io.savemat(tmp_path / "plain.mat", content, **options)
    return (tmp_path / "plain.mat").read_bytes()[128:]


def with_word(content: bytes, place: int, word: int) -> bytes:
    return content[: 4 * place] + struct.pack("<I", word) + content[4 * place + 4 :]


PLACES = {
    "a variable of no known type": (0, 77, "a variable of type 77 with 392 bytes"),
    "a variable longer than the file": (1, 4000, "a variable of type 14 with 4000 bytes"),
    "an array of no known class": (4, 99, "an array of class 99"),
    "sizes below zero": (8, 2**32 - 1, r"an array of sizes \(-1, 41\)"),
    "sizes that its numbers do not fill": (9, 42, "42 numbers of type 9 in 328 bytes"),
    "numbers of no known type": (16, 88, "an element of type 88 with 328 bytes"),
    "numbers longer than their variable": (17, 3000, "an element of type 9 with 3000 bytes"),
}


PACKED = [rule for rule, (place, *_) in PLACES.items() if place > 1]
"""A compressed variable has no type and size of its own."""


@pytest.mark.parametrize(("rule", "compressed"), [(rule, False) for rule in PLACES] + [(rule, True) for rule in PACKED])
def test_a_mat_file_that_lies_is_not_given_to_scipy(tmp_path, rule, compressed):
    place, word, why = PLACES[rule]
    content = with_word(variable({"a_name_of_ten": TIME}, tmp_path), place, word)
    if compressed:
        packed = zlib.compress(content)
        content = struct.pack("<II", 15, len(packed)) + packed
    header = (tmp_path / "plain.mat").read_bytes()[:128]
    (tmp_path / "run.mat").write_bytes(header + content)
    assert re.search(rf"can't be read \(ValueError: {why}\); it is broken", refusal(tmp_path / "run.mat"))


@pytest.mark.parametrize("compressed", [False, True])
def test_whatever_matlab_saves_is_sound(tmp_path, compressed):
    """Text, cells, structs in structs, sparse and complex arrays, empty ones, and one whose name is long."""
    cells = np.array([TIME, "text", np.array([])], dtype=object)
    others = {
        "s": {"t": {"u": TIME, "text": "text"}},
        "sparse": scipy.sparse.eye(3).tocsc(),
        "z": 1j * TIME,
        "a" * 60: 1,
    }
    content = {"time": TIME, "x_d": TIME, "cells": cells, "empty": np.zeros((0, 3)), "yes": TIME > 0, **others}
    scipy.io.savemat(tmp_path / "run.mat", content, do_compression=compressed, long_field_names=True)
    trace = vgtjax.load_trace(tmp_path / "run.mat", channels={"x_d": vgtjax.Source(unit="mm")})
    np.testing.assert_array_equal(trace.x_d, TIME * 1e-3)


@pytest.mark.parametrize("name", ["run.mf4", "run.mdf"])
def test_a_channel_outside_of_its_record_is_not_given_to_asammdf(tmp_path, monkeypatch, name):
    import asammdf

    WRITERS[name](tmp_path / name, campaign())
    opened = asammdf.MDF.__init__

    def move(self, *given, **options):
        opened(self, *given, **options)
        for channel in self.groups[0].channels:
            if channel.name == "x_d":
                setattr(channel, "byte_offset" if name == "run.mf4" else "start_offset", 5000)

    monkeypatch.setattr(asammdf.MDF, "__init__", move)
    assert "(ValueError: 'x_d' lies outside of its record of 16 bytes); it is broken" in refusal(tmp_path / name)
