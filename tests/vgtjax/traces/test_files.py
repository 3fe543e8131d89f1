"""Files of loggers: the same campaign from any of them is the same trace, with the clocks that the file has."""

import contextlib
import pathlib
import sys

import asammdf
import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow
import pyarrow.parquet
import pytest
import scipy.io
from recorded import COUNT, UNITS, WRITERS, Signal, campaign, save_frames, sources_for, write_mdf, write_timetable

import vgtjax
from vgtjax.traces.files import Recording, _mat_variables, open_recording

BINARY = [name for name in WRITERS if name != "run.csv"]
TIME = np.arange(COUNT) * 1e-3


def load(path: pathlib.Path, **options) -> vgtjax.Trace:
    return vgtjax.load_trace(path, channels=sources_for(path, campaign()), **options)


def assert_same(trace: vgtjax.Trace, other: vgtjax.Trace) -> None:
    """Times and values from text and from counts differ by their last bits, 1e-16 of the largest."""
    assert trace.channels.keys() == other.channels.keys()
    assert trace.notes == other.notes
    for name, channel in other.channels.items():
        np.testing.assert_allclose(trace.channels[name].time, channel.time, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(trace.channels[name].value, channel.value, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("name", BINARY)
def test_every_kind_of_file_gives_the_trace_of_the_csv(tmp_path, name):
    WRITERS["run.csv"](tmp_path / "run.csv", campaign())
    WRITERS[name](tmp_path / name, campaign())
    trace = load(tmp_path / name, name="run")
    assert trace.has_common_clock
    assert trace.notes == ()
    assert_same(trace, vgtjax.load_trace(tmp_path / "run.csv"))


@pytest.mark.parametrize("name", BINARY)
def test_channels_keep_the_clocks_of_their_file(tmp_path, name):
    WRITERS[name](tmp_path / name, campaign(slow=5))
    trace = load(tmp_path / name)
    signals = campaign(slow=5)
    assert not trace.has_common_clock
    for channel, signal in signals.items():
        np.testing.assert_allclose(trace.channels[channel].time, signal.time, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(trace.x_d, signals["x_d"].value * 1e-3, rtol=1e-12)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_timetables_have_times_of_their_own(tmp_path, version):
    write_mdf(tmp_path / "run.mf4", campaign(slow=5))
    write_timetable(tmp_path / "run.mat", campaign(slow=5), version)
    assert_same(load(tmp_path / "run.mat"), load(tmp_path / "run.mf4"))


def test_row_times_that_are_dates_count_from_the_first(tmp_path):
    dates = pd.Index(np.datetime64("2026-01-01T12:00", "us") + np.round(TIME * 1e6).astype("m8[us]"), name="Time")
    save_frames(tmp_path / "run.mat", {"run": pd.DataFrame({"x_d": TIME}, index=dates)})
    trace = vgtjax.load_trace(tmp_path / "run.mat", channels={"x_d": vgtjax.Source(unit="mm")})
    np.testing.assert_allclose(trace.time, TIME, atol=1e-9)  # dates are stored to the nanosecond


def test_samples_that_are_marked_as_invalid_are_skipped(tmp_path):
    signals = campaign()
    wild = np.zeros(COUNT, dtype=bool)
    wild[10:20] = True
    counts = np.where(wild, 30000, signals["x_d"].counts).astype("i2")
    signals["x_d"] = Signal(TIME, counts, 0.01, "mm", wild)
    write_mdf(tmp_path / "run.mf4", signals)
    trace = load(tmp_path / "run.mf4")
    np.testing.assert_allclose(trace.channels["x_d"].time, TIME[~wild], atol=1e-15)
    assert np.max(trace.x_d) < 2e-3
    assert trace.notes == ("channel 'x_d': 10 samples are marked as invalid and skipped",)


def test_an_input_must_be_valid_without_a_gap(tmp_path):
    signals = campaign()
    wild = np.zeros(COUNT, dtype=bool)
    wild[10:20] = True
    signals["pwm"] = Signal(TIME, signals["pwm"].counts, 0.5, "%", wild)
    write_mdf(tmp_path / "run.mf4", signals)
    with pytest.raises(vgtjax.InputError, match=r"pwm of group 0, sample 21: time has a gap of 0\.011 where the med"):
        load(tmp_path / "run.mf4")


def test_an_input_that_is_invalid_at_an_end_ends_the_trace_there(tmp_path):
    """Nobody knows a reservoir before its first valid sample."""
    signals = campaign()
    wild = np.arange(COUNT) < 21
    signals["p_res"] = Signal(TIME, signals["p_res"].counts, 0.5, "mbar gauge", wild)
    write_mdf(tmp_path / "run.mf4", signals)
    trace = load(tmp_path / "run.mf4")
    np.testing.assert_allclose(trace.time, TIME[~wild], atol=1e-15)
    assert trace.notes == (
        "channel 'p_res': 21 samples are marked as invalid and skipped",
        *(f"of 0.04 s of {name} only 0.019 s are in the time that all channels share" for name in UNITS),
    )


def test_a_duty_that_stops_early_is_held_no_longer_than_a_gap(tmp_path):
    signals = campaign()
    signals["pwm"] = Signal(TIME[:21], signals["pwm"].counts[:21], 0.5, "%")
    write_mdf(tmp_path / "run.mf4", signals)
    trace = load(tmp_path / "run.mf4")
    assert trace.time[-1] == pytest.approx(0.025)  # five steps behind its last sample
    others = [name for name in UNITS if name != "pwm"]
    noted = (f"of 0.04 s of {name} only 0.025 s are in the time that all channels share" for name in others)
    assert sorted(trace.notes) == sorted(noted)
    assert trace.window(0.0, 0.023).time[-1] == pytest.approx(0.023)
    for otherwise in (
        trace.with_late_duty(0.0015),
        trace.with_ramped_duty(),
        trace.with_ramped_duty().with_held_duty(),
    ):
        assert otherwise.time[-1] == pytest.approx(0.025)  # a duty that is read otherwise goes on no longer


def test_a_slow_duty_goes_on_to_the_end_of_the_others(tmp_path):
    signals = campaign()
    signals["pwm"] = Signal(TIME[:-4:5], signals["pwm"].counts[:-4:5], 0.5, "%")
    write_mdf(tmp_path / "run.mf4", signals)
    trace = load(tmp_path / "run.mf4")
    assert (trace.time[-1], trace.notes) == (pytest.approx(0.04), ())


def test_a_struct_array_of_controldesk(tmp_path):
    fields = [("Name", object), ("Data", object), ("Unit", object), ("XIndex", object)]
    signals = [("x_d", TIME, "mm", 2), ("pwm", TIME[::5], "%", 1)]
    axes = np.array([(TIME[::5],), (TIME,)], dtype=[("Data", object)])
    capture = {"X": axes, "Y": np.array(signals, dtype=fields)}
    scipy.io.savemat(tmp_path / "run.mat", {"capture": capture})
    trace = vgtjax.load_trace(tmp_path / "run.mat")
    np.testing.assert_array_equal(trace.channels["x_d"].time, TIME)
    np.testing.assert_array_equal(trace.channels["pwm"].time, TIME[::5])


def test_variables_of_a_mat_file_with_clocks_by_name(tmp_path):
    variables = {"t_ms": TIME * 1e3, "duty": np.zeros(COUNT), "t_slow": TIME[::5] * 1e3, "x": TIME[::5], "rpm": 900.0}
    scipy.io.savemat(tmp_path / "run.mat", variables)
    channels = {
        "time": vgtjax.Source("t_ms", unit="ms"),
        "pwm": vgtjax.Source("duty", unit="%"),
        "x_d": vgtjax.Source("x", unit="mm", time="t_slow"),
    }
    trace = vgtjax.load_trace(tmp_path / "run.mat", channels=channels)
    np.testing.assert_allclose(trace.channels["pwm"].time, TIME, rtol=1e-12)
    np.testing.assert_allclose(trace.channels["x_d"].time, TIME[::5], rtol=1e-12)


@pytest.mark.parametrize(
    "unit", ["mm", np.bytes_("mm"), np.array(["mm"], dtype=h5py.string_dtype()), np.array([b"mm"])]
)
def test_a_dataset_of_hdf5_may_state_its_unit(tmp_path, unit):
    with h5py.File(tmp_path / "run.mat", "w") as file:
        file["time"] = TIME
        file["x_d"] = TIME
        file["x_d"].attrs["unit"] = unit
    np.testing.assert_allclose(vgtjax.load_trace(tmp_path / "run.mat").x_d, TIME * 1e-3, rtol=1e-15)


@pytest.mark.parametrize("stated", [False, True], ids=["by custom", "stated"])
def test_a_time_of_matlab_is_in_seconds_unless_the_map_says_another_unit(tmp_path, stated):
    scipy.io.savemat(tmp_path / "run.mat", {"time": TIME * 1e3 if stated else TIME, "x_d": TIME})
    channels = {"x_d": vgtjax.Source(unit="mm"), **({"time": vgtjax.Source(unit="ms")} if stated else {})}
    np.testing.assert_allclose(vgtjax.load_trace(tmp_path / "run.mat", channels=channels).time, TIME, rtol=1e-12)


def test_a_time_in_a_table_of_matlab_has_the_unit_that_the_table_says(tmp_path, monkeypatch):
    table = pd.DataFrame({"time": TIME * 1e3, "x_d": TIME})
    table.attrs["VariableUnits"] = ["ms", "mm"]
    monkeypatch.setattr(_mat_variables, "load_objects", lambda path, name: {name: table})
    units = [entry.stated_unit for entry, _ in _mat_variables.list_table(tmp_path / "run.mat", "run")]
    assert units == ["ms", "mm"]


def test_waveforms_that_began_apart_stay_apart(tmp_path):
    begin = np.datetime64("2026-01-01T12:00:00", "us")
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as file:
        for name, unit, late in (("pwm", "%", 0), ("x_d", "mm", 250)):
            clock = {"wf_start_time": begin + np.timedelta64(late, "us"), "wf_increment": 1e-3, "wf_start_offset": 0.0}
            file.write_segment([nptdms.ChannelObject(name, name, np.zeros(COUNT), clock | {"unit_string": unit})])
    trace = vgtjax.load_trace(tmp_path / "run.tdms")
    np.testing.assert_allclose(trace.channels["x_d"].time - trace.channels["pwm"].time, 250e-6, atol=1e-12)


def test_dates_beside_a_tdms_channel_and_in_a_parquet_column(tmp_path):
    dates = np.datetime64("2026-01-01T12:00:00", "us") + np.round(TIME * 1e6).astype("m8[us]")
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as file:
        unit = {"unit_string": "mm"}
        file.write_segment([nptdms.ChannelObject("g", "time", dates), nptdms.ChannelObject("g", "x_d", TIME, unit)])
    table = pyarrow.table({"time": dates, "x_d [mm]": TIME})
    pyarrow.parquet.write_table(table, tmp_path / "run.parquet")
    for name in ("run.tdms", "run.parquet"):
        np.testing.assert_allclose(vgtjax.load_trace(tmp_path / name).time, TIME, rtol=1e-12)


def test_a_dat_file_is_mdf_3_or_text(tmp_path):
    write_mdf(tmp_path / "run.mdf", campaign())
    WRITERS["run.csv"](tmp_path / "text.dat", campaign())
    (tmp_path / "run.mdf").rename(tmp_path / "run.dat")
    assert_same(load(tmp_path / "run.dat"), load(tmp_path / "text.dat"))


@pytest.mark.parametrize("name", BINARY)
def test_only_what_is_mapped_is_read(tmp_path, monkeypatch, name):
    signals = campaign()
    others = {f"rpm_{i}": Signal(TIME, np.arange(COUNT, dtype="i2"), 1.0, "1/min") for i in range(50)}
    WRITERS[name](tmp_path / name, others | signals)
    with contextlib.closing(open_recording(tmp_path / name)) as recording:
        kind = type(recording)
    asked, read = [], kind.read
    monkeypatch.setattr(kind, "read", lambda self, entry: asked.append(entry.label) or read(self, entry))
    trace = load(tmp_path / name)
    assert set(asked) - {"time"} == set(UNITS)
    assert any(note.startswith("50 ") and note.endswith("s of the file are not used") for note in trace.notes)


def test_asammdf_is_asked_for_no_other_channel(tmp_path, monkeypatch):
    others = {f"rpm_{i}": Signal(TIME, np.arange(COUNT, dtype="i2"), 1.0, "1/min") for i in range(5)}
    write_mdf(tmp_path / "run.mf4", others | campaign())
    asked, get = [], asammdf.MDF.get
    monkeypatch.setattr(asammdf.MDF, "get", lambda self, **which: asked.append(which["index"]) or get(self, **which))
    load(tmp_path / "run.mf4")
    assert sorted(asked) == [6, 7, 8, 9]  # behind the times and five others


@pytest.mark.parametrize(
    ("name", "package", "extra"),
    [
        ("run.mf4", "asammdf", "mdf"),
        ("run.tdms", "nptdms", "tdms"),
        ("run_73.mat", "h5py", "mat"),
        ("run.parquet", "pyarrow.parquet", "parquet"),
    ],
)
def test_a_missing_package_is_one_sentence(tmp_path, monkeypatch, name, package, extra):
    WRITERS[name](tmp_path / name, campaign())
    monkeypatch.setitem(sys.modules, package, None)
    shown = package.split(".")[0]
    with pytest.raises(
        vgtjax.InputError,
        match=rf"^{name}: this file is read by the package {shown}, which is not installed; run pip install "
        rf"'\.\[{extra}\]' in a clone of vgtjax$",
    ):
        load(tmp_path / name)


def test_only_timetables_need_mat_io(tmp_path, monkeypatch):
    write_timetable(tmp_path / "table.mat", campaign(), "v7")
    WRITERS["run.mat"](tmp_path / "run.mat", campaign())
    monkeypatch.setitem(sys.modules, "matio", None)
    assert load(tmp_path / "run.mat").p_act is not None
    with pytest.raises(vgtjax.InputError, match=r"^table\.mat: this file is read by the package matio, which is not"):
        vgtjax.load_trace(tmp_path / "table.mat", channels=sources_for(tmp_path / "table.mat", campaign()))


def test_every_reader_lists_and_closes(tmp_path):
    for name, write in WRITERS.items():
        write(tmp_path / name, campaign())
        with contextlib.closing(open_recording(tmp_path / name)) as recording:
            assert isinstance(recording, Recording)
            assert set(UNITS) <= {entry.label for entry in recording.entries}
        (tmp_path / name).unlink()
