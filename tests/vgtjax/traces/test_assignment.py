"""Channels of a file by a map: names, groups, scales, and what is said where a map does not fit."""

import asammdf
import nptdms
import numpy as np
import pytest
import scipy.io
from recorded import COUNT, Signal, campaign, mdf_signal, write_mdf, write_tdms

import vgtjax
from vgtjax import Source

TIME = np.arange(COUNT) * 1e-3
FOREIGN = "t [ms];DutyCycle (%);P_act_raw [V];Pos [mm];n [1/min]\n" + "".join(
    f"{i};20;{1.0 - 0.01 * i:.2f};{0.1 * i:.1f};900\n" for i in range(12)
)
SOURCES = {
    "time": Source("t"),
    "pwm": Source("DutyCycle (%)", unit="%"),
    "p_act": Source("P_act_raw", unit="mbar gauge", scale=1000.0, offset=-1000.0),
    "x_d": Source("Pos"),
}


@pytest.fixture
def foreign(tmp_path):
    """A text table of somebody else."""
    (tmp_path / "bench.csv").write_text(FOREIGN)
    return tmp_path / "bench.csv"


@pytest.fixture
def logged(tmp_path):
    """A file with the names of a logger."""
    signals = campaign()
    write_mdf(tmp_path / "run.mf4", {"Duty": signals["pwm"], "P_Kammer": signals["p_act"], "Pos": signals["x_d"]})
    return tmp_path / "run.mf4"


def refusal(path, channels, **options) -> str:
    with pytest.raises(vgtjax.InputError) as error:
        vgtjax.load_trace(path, channels=channels, **options)
    return str(error.value)


def test_a_foreign_text_table_is_mapped(foreign):
    trace = vgtjax.load_trace(foreign, channels=SOURCES, needs=("pwm", "x_d|p_act"))
    np.testing.assert_allclose(trace.time, np.arange(12) * 1e-3, rtol=1e-15)
    np.testing.assert_array_equal(trace.pwm, 20.0)
    # Pressures of 1e5 Pa are good to 1e-11 Pa.
    np.testing.assert_allclose(trace.p_act, 101013.0 - 1000.0 * np.arange(12), atol=1e-9)
    np.testing.assert_allclose(trace.x_d, 1e-4 * np.arange(12), rtol=1e-14)
    assert trace.notes == (
        "column 'n' is not used",
        "no column p_res; 20000 Pa absolute is assumed for the reservoir",
    )


def test_a_mapped_column_without_unit_gets_it_in_the_map(foreign):
    sentence = "column DutyCycle (%): the unit is missing; write e.g. unit = '%' in channels.pwm"
    assert refusal(foreign, {**SOURCES, "pwm": Source("DutyCycle (%)")}).endswith(sentence)


def test_a_file_of_foreign_names_says_that_they_can_be_mapped(foreign):
    assert refusal(foreign, None).endswith("or state in channels which column is which")


def test_a_map_does_not_disturb_a_file_with_our_own_names(tmp_path):
    write_mdf(tmp_path / "run.mf4", campaign())
    plain = vgtjax.load_trace(tmp_path / "run.mf4")
    foreign = Source("P_boost", unit="kPa absolute", scale=250.0, offset=1.0)  # of the study's other files
    mapped = vgtjax.load_trace(tmp_path / "run.mf4", channels={"p_act": foreign})
    np.testing.assert_array_equal(mapped.p_act, plain.p_act)


def test_scale_and_offset_count_before_the_unit(tmp_path):
    signals = {"raw": Signal(TIME, np.arange(COUNT, dtype="i2"), 1.0, "V")}
    write_mdf(tmp_path / "run.mf4", signals)
    source = Source("raw", unit="kPa gauge", scale=-2.0, offset=1.0)
    trace = vgtjax.load_trace(tmp_path / "run.mf4", channels={"p_act": source})
    np.testing.assert_allclose(trace.p_act, 101013.0 + 1e3 * (1.0 - 2.0 * np.arange(COUNT)), rtol=1e-15)


@pytest.mark.parametrize(
    ("channels", "sentence"),
    [
        (
            {**SOURCES, "p_act": Source("P_akt_raw", unit="mbar gauge")},
            "line 1, column p_act: no column is called P_akt_raw; name it in channels.p_act, the nearest names are "
            "'P_act_raw', 't', 'Pos'",
        ),
        (
            {**SOURCES, "p_act": Source("P_act_raw")},
            "line 1, column P_act_raw: the unit 'V' is not known here; use one of Pa, kPa, mbar, bar, each followed by "
            "gauge or absolute",
        ),
        (
            {**SOURCES, "p_act": Source("P_act_raw", unit="mbar", scale=1000.0)},
            "line 1, column P_act_raw: a pressure must be gauge or absolute, but its unit is 'mbar'; write unit = "
            "'mbar gauge' or unit = 'mbar absolute' in channels.p_act",
        ),
        (
            {**SOURCES, "x_d": Source("Pos", unit="um")},
            "line 1, column Pos: the file says that its unit is 'mm', but channels.x_d says 'um'; correct the unit, or "
            "state the scale between them",
        ),
        (
            {**SOURCES, "time": Source("t", unit="s")},
            "line 1, column t: the file says that its unit is 'ms', but channels.time says 's'; correct the unit, or "
            "state the scale between them",
        ),
        (
            {"x_d": Source("Pos")},
            "line 1, column time: no column is called time; name it in channels.time, the nearest names are 't', "
            "'DutyCycle (%)', 'P_act_raw'",
        ),
    ],
)
def test_a_map_that_does_not_fit_is_refused(foreign, channels, sentence):
    assert refusal(foreign, channels, needs=("pwm",)) == f"bench.csv, {sentence}"


def test_a_map_of_what_is_no_signal_is_refused(foreign):
    assert refusal(foreign, {"p_atc": Source("Pos")}) == (
        "channels must be of the signals time, pwm, p_act, p_res, p_trb, x_d, f_vane, f_drive, but there is 'p_atc'; "
        "did you mean 'p_act'?"
    )


def test_a_required_channel_that_is_not_mapped_is_named_with_the_nearest(logged):
    assert refusal(logged, {"pwm": Source("Duty"), "x_d": Source("Pos")}, needs=("pwm", "p_act")) == (
        "run.mf4, channel p_act: no channel is called p_act; name it in channels.p_act, the nearest names are "
        "'P_Kammer', 'Pos', 'Duty'"
    )
    assert refusal(logged, {"pwm": Source("Duty")}, needs=("pwm", "x_d|p_act")) == (
        "run.mf4, channel x_d or p_act: no channel is called x_d or p_act; name it in channels.x_d or channels.p_act, "
        "the nearest names are 'P_Kammer', 'Duty', 'Pos'"
    )


def test_names_in_several_groups_need_a_group(tmp_path):
    fast = campaign()
    with_slow = {"x_d": Signal(TIME[::2], fast["x_d"].counts[::2], 0.02, "mm")}
    write_twice(tmp_path / "run.mf4", fast, with_slow)
    assert refusal(tmp_path / "run.mf4", None) == (
        "run.mf4, channel x_d: a name must be unique, but 'x_d' is in the groups 0, 1; state which with group in "
        "channels.x_d"
    )
    trace = vgtjax.load_trace(tmp_path / "run.mf4", channels={"x_d": Source(group=1)})
    np.testing.assert_allclose(trace.x_d, 2e-5 * fast["x_d"].counts[::2], rtol=1e-12)
    assert refusal(tmp_path / "run.mf4", {"x_d": Source(group=2)}) == (
        "run.mf4, channel x_d: no channel is called x_d in group 2; name it in channels.x_d, the nearest names are "
        "'x_d', 'p_res', 'p_act'"
    )


def write_twice(path, first, second) -> None:
    """Two groups that share names, which one dictionary can't have."""
    with asammdf.MDF(version="4.10") as file:
        for group in (first, second):
            file.append([mdf_signal(*pair) for pair in group.items()])
        file.save(path, overwrite=True)


def test_groups_of_tdms_have_names(tmp_path):
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as file:
        for group in ("bench", "cell 2"):
            clock = {"wf_increment": 1e-3, "wf_start_offset": 0.0, "unit_string": "mm"}
            file.write_segment([nptdms.ChannelObject(group, "x_d", TIME * (2 if group == "cell 2" else 1), clock)])
    assert refusal(tmp_path / "run.tdms", None) == (
        "run.tdms, channel x_d: a name must be unique, but 'x_d' is in the groups bench, cell 2; state which with "
        "group in channels.x_d"
    )
    trace = vgtjax.load_trace(tmp_path / "run.tdms", channels={"x_d": Source(group="cell 2")})
    np.testing.assert_allclose(trace.x_d, 2e-3 * TIME, rtol=1e-15)


def test_samples_and_times_must_be_as_many(tmp_path):
    scipy.io.savemat(tmp_path / "run.mat", {"time": TIME, "x_d": TIME[::2]})
    assert refusal(tmp_path / "run.mat", {"x_d": Source(unit="mm")}) == (
        "run.mat, channel x_d: a channel must have one sample per time, but it has 21 samples and 41 times; name the "
        "channel with its times by time in channels.x_d"
    )


def test_text_is_no_signal(tmp_path):
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as file:
        clock = {"wf_increment": 1e-3, "wf_start_offset": 0.0}
        file.write_segment([nptdms.ChannelObject("g", "x_d", np.array(["a", "b"]), clock)])
    assert refusal(tmp_path / "run.tdms", {"x_d": Source(unit="mm")}) == (
        "run.tdms, channel x_d of group g: a channel must have one number per sample, but it has text; choose another"
    )


def test_clocks_that_hardly_overlap_are_noted(tmp_path):
    signals = campaign()
    late = {"x_d": Signal(TIME + 0.03, signals["x_d"].counts, 0.01, "mm")}
    write_twice(tmp_path / "run.mf4", {"p_res": signals["p_res"]}, late)
    assert vgtjax.load_trace(tmp_path / "run.mf4").notes == (
        "of 0.04 s of p_res only 0.01 s are in the time that all channels share",
        "of 0.04 s of x_d only 0.01 s are in the time that all channels share",
    )


def test_clocks_that_do_not_overlap_are_refused(tmp_path):
    signals = campaign()
    late = {"x_d": Signal(TIME + 1.0, signals["x_d"].counts, 0.01, "mm")}
    before = {"pwm": signals["pwm"], "p_act": signals["p_act"]}
    write_twice(tmp_path / "run.mf4", before, late)
    assert refusal(tmp_path / "run.mf4", None) == (
        "run: a trace must have at least two samples in the time that its signals share, but that runs from 1 s to "
        "0.04 s; record more, or check the clocks"
    )


def test_a_tdms_file_in_our_own_form_may_have_units_in_its_names(tmp_path):
    signals = {f"{name} [{s.unit}]": Signal(s.time, s.counts, s.step, None) for name, s in campaign().items()}
    write_tdms(tmp_path / "run.tdms", signals)
    write_mdf(tmp_path / "run.mf4", campaign())
    trace, other = (vgtjax.load_trace(tmp_path / name) for name in ("run.tdms", "run.mf4"))
    np.testing.assert_allclose(trace.p_act, other.p_act, rtol=1e-12)


def test_times_that_a_channel_names_are_those_and_no_others(tmp_path):
    scipy.io.savemat(tmp_path / "run.mat", {"time": TIME, "t_slow": 2 * TIME, "x_d": TIME})
    source = Source(unit="mm", time="t_slow")
    assert vgtjax.load_trace(tmp_path / "run.mat", channels={"x_d": source, "time": Source(unit="s")}).time[-1] == 0.08
    assert refusal(tmp_path / "run.mat", {"x_d": Source(unit="mm", time="t_slwo")}) == (
        "run.mat, channel time: no channel is called t_slwo; name it in channels.time, the nearest names are 't_slow', "
        "'x_d', 'time'"
    )


def test_a_unit_for_what_a_file_does_not_have_is_no_mistake(foreign):
    trace = vgtjax.load_trace(foreign, channels={**SOURCES, "p_trb": Source(unit="bar gauge")})
    assert trace.p_trb is None


def test_a_struct_with_fields_x_and_y_is_a_struct(tmp_path):
    scipy.io.savemat(tmp_path / "run.mat", {"run": {"time": TIME, "X": TIME, "Y": 2 * TIME}})
    trace = vgtjax.load_trace(tmp_path / "run.mat", channels={"x_d": Source("Y", unit="mm")})
    np.testing.assert_allclose(trace.x_d, 2e-3 * TIME, rtol=1e-15)


def test_matrices_and_numbers_are_no_channels(tmp_path):
    scipy.io.savemat(tmp_path / "run.mat", {"time": TIME, "x_d": np.zeros((COUNT, 2)), "pwm": 1.0, "f_vane": TIME})
    trace = vgtjax.load_trace(tmp_path / "run.mat", channels={"f_vane": Source(unit="N")})
    assert list(trace.channels) == ["f_vane"]
