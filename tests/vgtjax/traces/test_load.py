"""Reading bench traces: what is understood, what is refused with which sentence, and what is noted."""

import pathlib
import re

import numpy as np
import pytest
import scipy
from bad_traces import BAD_TRACES, HEADER, ROWS, BadTrace, text, with_cell, with_header, without_column

import vgtjax
from vgtjax.traces import TRAVEL, UNITS

NEEDS = ("pwm", "x_d|p_act")
"""What a fit of the full model asks of a trace."""


@pytest.fixture
def load(tmp_path):
    """Loads a text or bytes as the trace `bench.csv`."""

    def load(content, **options):
        path = tmp_path / "bench.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return vgtjax.load_trace(path, **options)

    return load


def assert_same(trace: vgtjax.Trace, other: vgtjax.Trace) -> None:
    for signal in ("time", "pwm", "p_act", "p_res", "x_d"):
        # Units are multiplied in another order: two roundings.
        np.testing.assert_allclose(getattr(trace, signal), getattr(other, signal), rtol=4e-16, atol=1e-18)


@pytest.mark.parametrize("case", BAD_TRACES.values(), ids=BAD_TRACES.keys())
def test_a_bad_trace_is_refused_in_one_sentence(load, case: BadTrace):
    with pytest.raises(vgtjax.InputError, match=f"^{re.escape(f'bench.csv, {case.sentence}')}$"):
        load(case.raw, needs=NEEDS)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(vgtjax.InputError, match=r"^no\.csv: can't be read \(No such file or directory\); check the"):
        vgtjax.load_trace(tmp_path / "no.csv")


def test_values_are_si_and_pressures_absolute(load):
    trace = load(text())
    row = [float(cell) for cell in ROWS[7].split(",")]
    seen = [trace.time[7], trace.pwm[7], trace.p_act[7], trace.p_res[7], trace.x_d[7]]
    expected = [row[0], row[1], row[2] * 100 + 101013, row[3] * 100 + 101013, row[4] * 1e-3]
    np.testing.assert_allclose(seen, expected, rtol=1e-15)
    assert trace.name == "bench"
    assert trace.notes == ()
    assert trace.p_trb is None


@pytest.mark.parametrize(
    "content",
    [
        pytest.param("\ufeff" + text(), id="byte-order mark"),
        pytest.param(text().encode("utf-16"), id="UTF-16 with its byte-order mark"),
        pytest.param(text().replace("\n", "\r\n"), id="line ends of Windows"),
        pytest.param(text().replace("\n", "\r"), id="line ends of old"),
        pytest.param(text()[:-1], id="no line end at the end"),
        pytest.param(text() + "\n\n", id="blank lines at the end"),
        pytest.param(text().replace(",", ";").replace(".", ","), id="semicolons and decimal commas"),
        pytest.param(text().replace(",", ";"), id="semicolons and decimal points"),
        pytest.param(text().replace(",", "\t").replace(".", ","), id="tabs and decimal commas"),
        pytest.param(text().replace(",", "\t"), id="tabs and decimal points"),
        pytest.param(text(re.sub(r"[^,]+", r'"\g<0>"', HEADER)), id="quoted header"),
        pytest.param(re.sub(r"[^,\n]+", r'"\g<0>"', text()), id="everything quoted"),
        pytest.param(text().replace(",", ", "), id="spaces after the delimiter"),
        pytest.param(with_header("[mbar gauge]", "[ mbar  gauge ]"), id="spaces in the unit"),
        pytest.param(with_header(" [", "["), id="no space before the unit"),
        pytest.param(
            text(",".join(HEADER.split(",")[::-1]), tuple(",".join(r.split(",")[::-1]) for r in ROWS)), id="order"
        ),
    ],
)
def test_text_may_be_written_in_many_ways(load, content):
    assert_same(load(content), load(text()))


SCALES = {"s": 1, "ms": 1e3, "%": 1, "1": 1e-2, "m": 1, "mm": 1e3, "um": 1e6, "N": 1}
PRESSURES = {"Pa": 1, "kPa": 1e-3, "mbar": 1e-2, "bar": 1e-5}


@pytest.mark.parametrize(
    ("signal", "unit"), [(s, u) for s, units in UNITS.items() for u in units if not s.startswith("p_")]
)
def test_every_listed_unit_is_read(load, signal, unit):
    values = np.linspace(0, 0.01, 11)
    rows = [f"{0.1 * i!r},{value * SCALES[unit]!r}" for i, value in enumerate(values.tolist())]
    if signal == "time":
        rows = [row.split(",")[1] for row in rows]
    header = "time [s]," * (signal != "time") + f"{signal} [{unit}]"
    trace = load(text(header, tuple(rows)))
    np.testing.assert_allclose(getattr(trace, signal), values, rtol=1e-14)


@pytest.mark.parametrize("unit", PRESSURES)
@pytest.mark.parametrize("signal", ["p_act", "p_res", "p_trb"])
def test_gauge_and_absolute_say_the_same(load, signal, unit):
    atmosphere = 98000.0
    absolute = np.linspace(20e3, 98e3, 11)
    traces = []
    for reference, shift in (("gauge", atmosphere), ("absolute", 0.0)):
        cells = ((absolute - shift) * PRESSURES[unit]).tolist()
        rows = tuple(f"{0.1 * i!r},{cell!r}" for i, cell in enumerate(cells))
        traces.append(load(text(f"time [s],{signal} [{unit} {reference}]", rows), atmosphere=atmosphere))
    expected = absolute - atmosphere if signal == "p_trb" else absolute  # the turbine's is gauge inside
    for trace in traces:
        # Differences of numbers near 1e5 Pa are good to 1e-11 Pa.
        np.testing.assert_allclose(getattr(trace, signal), expected, atol=1e-10)


def test_gauge_counts_from_the_atmosphere_of_the_trace(load):
    standard, high = load(text()), load(text(), atmosphere=95000.0)
    np.testing.assert_allclose(high.p_act - standard.p_act, 95000.0 - 101013.0, atol=1e-10)
    assert (standard.atmosphere, high.atmosphere) == (101013.0, 95000.0)


@pytest.mark.parametrize(
    ("column", "cell"),
    [
        ("x_d", "-0.5"),
        ("x_d", "10.63"),
        ("p_act", "50"),
        ("p_act", "-1060.13"),
        ("p_res", "50"),
        ("pwm", "100"),
        ("pwm", "0"),
    ],
)
def test_sensors_may_be_off_by_half_a_millimetre_and_50_mbar(load, column, cell):
    assert len(load(with_cell(13, column, cell)).time) == len(ROWS)


def test_an_actuator_with_more_travel_may_move_further(load):
    assert load(with_cell(13, "x_d", "12.4"), travel=12e-3).x_d[-1] == pytest.approx(12.4e-3)
    with pytest.raises(vgtjax.InputError, match=r"12\.6 \[mm\] is outside what .* \(-0\.0005 to 0\.0125 m\)"):
        load(with_cell(13, "x_d", "12.6"), travel=12e-3)


def test_the_reader_knows_the_printed_travel():
    assert float(vgtjax.Diaphragm().travel) == TRAVEL


def test_a_rig_driven_by_a_force_may_stand_anywhere(load):
    trace = load(with_cell(13, "x_d", "80").replace("p_res [mbar gauge]", "f_drive [N]"))
    assert trace.x_d[-1] == pytest.approx(80e-3)
    assert trace.f_drive[0] == -800.0
    assert trace.notes == ()


def test_a_step_of_exactly_five_medians_is_no_gap(load):
    assert load(with_cell(13, "time", "0.015")).time[-1] == 0.015


def test_a_reservoir_that_nobody_measured_is_assumed_with_a_note(load):
    trace = load(without_column("p_res"))
    assert trace.p_res is None
    assert trace.notes == ("no column p_res; 20000 Pa absolute is assumed for the reservoir",)
    np.testing.assert_array_equal(trace.drive().reservoir.start, 20000.0)


def test_a_trace_without_a_duty_asks_for_no_reservoir(load):
    columns = HEADER.split(",")
    kept = [place for place, column in enumerate(columns) if not column.startswith(("p_res", "pwm"))]
    rows = [",".join(row.split(",")[place] for place in kept) for row in (HEADER, *ROWS)]
    assert load("\n".join(rows) + "\n").notes == ()


@pytest.mark.parametrize("name", ["x_p", "v_p", "v_d", "z", "T_act", "m_dot_in", "m_dot_out"])
def test_states_that_simulate_writes_are_ignored_with_a_note(load, name):
    content = text(f"{HEADER},{name} [?]", tuple(f"{row},no number" for row in ROWS))
    trace = load(content)
    assert_same(trace, load(text()))
    assert trace.notes == (f"column '{name}' is not used",)


@pytest.mark.parametrize(
    ("header", "note"),
    [
        ("comment", "column 'comment' is not used"),
        ("temperature [°C]", "column 'temperature' is not used"),
        ("x_d raw [V]", "column 'x_d raw' is not used"),
        ("", "a column without a name is not used"),
    ],
)
def test_other_columns_are_ignored_with_a_note(load, header, note):
    trace = load(text(f"{HEADER},{header}", tuple(f"{row}," for row in ROWS)))
    assert_same(trace, load(text()))
    assert trace.notes == (note,)


def test_a_caller_may_ignore_a_column(load):
    trace = load(with_header("p_res [mbar gauge]", "f_drive [N]"), ignore=("f_drive",))
    assert trace.f_drive is None
    assert "column 'f_drive' is not used" in trace.notes


def test_one_of_several_columns_is_enough(load):
    assert load(without_column("x_d"), needs=NEEDS).x_d is None
    assert load(without_column("p_act"), needs=NEEDS).p_act is None


def test_neither_of_two_columns_is_not(load):
    only_inputs = text("time [s],pwm [%]", tuple(row.rsplit(",", 3)[0] for row in ROWS))
    sentence = (
        "bench.csv, line 1, column x_d or p_act: the column is missing; add a column 'x_d [mm]' or 'p_act [mbar "
        "gauge]', or state in channels which column is which"
    )
    with pytest.raises(vgtjax.InputError, match=f"^{re.escape(sentence)}$"):
        load(only_inputs, needs=NEEDS)


def test_a_long_cell_is_not_repeated_in_full(load):
    with pytest.raises(vgtjax.InputError, match=r"^bench\.csv, line 3, column x_d: 'x{40}\.\.\.' is not a number;"):
        load(with_cell(3, "x_d", "x" * 1000))


def test_path_may_be_text_and_the_name_chosen(load, tmp_path: pathlib.Path):
    load(text())
    assert vgtjax.load_trace(str(tmp_path / "bench.csv"), name="first").name == "first"


def _noisy(noise=0.6, lowest=-np.inf, seed=3, behind=0.0):
    """mbar: a fall from atmosphere to -620 mbar and back, at 1 kHz, with noise, of a sensor that shows no less."""
    time = np.arange(4000) * 1e-3
    signal = -620 * (np.clip(time / 0.5, 0, 1) - np.clip((time - 2) / 0.5, 0, 1))
    white = noise * np.random.default_rng(seed).normal(size=len(time))
    return np.maximum(signal + scipy.signal.lfilter([1.0], [1.0, -behind], white), lowest)


def _recorded(values, digits=4):
    rows = [f"{0.001 * k:.3f},40,{value:.{digits}f},-800,1.0" for k, value in enumerate(values)]
    return "\n".join(["time [s],pwm [%],p_act [mbar gauge],p_res [mbar gauge],x_d [mm]", *rows])


def test_samples_at_an_end_of_a_sensors_range_are_skipped(load):
    """The sensor shows no less than -600 mbar; the chamber was below that from 0.484 to 2.016 s."""
    trace = load(_recorded(_noisy(lowest=-600.0)))
    (note,) = trace.notes
    assert re.fullmatch(
        r"column 'p_act': \d+ of 4000 samples are at an end of what their sensor shows, and skipped; use one with a "
        "wider range",
        note,
    )
    left = trace.sampled("p_act")
    assert not np.any((left.time > 0.486) & (left.time < 2.014))
    # Beside the end four deviations of the noise, 2.4 mbar: 2 ms of the fall. Nothing else is missing.
    assert len(left.time) == pytest.approx(4000 - 1532 - 4, abs=4)


@pytest.mark.parametrize(
    "values",
    [
        pytest.param(_noisy(), id="a sensor that shows all"),
        pytest.param(_noisy(behind=0.78), id="behind a filter"),
        pytest.param(_noisy(noise=0.0), id="a simulated signal without noise"),
        pytest.param(np.round(_noisy()), id="a record coarser than its noise"),
    ],
)
def test_a_signal_at_rest_is_at_no_end_of_its_range(load, values):
    """Nor does a logger repeat its values."""
    assert load(_recorded(values)).notes == ()


@pytest.mark.parametrize("times", [2, 5, 10])
def test_of_values_that_a_logger_repeats_the_first_count(load, times):
    slow = _noisy()[::times]
    trace = load(_recorded(np.repeat(slow, times)))
    said = f"each value stands for several samples, so only the first counts: {len(slow)} of {times * len(slow)}"
    assert trace.notes == (f"column 'p_act': {said}",)
    found = trace.sampled("p_act")
    np.testing.assert_allclose(found.time, 1e-3 * times * np.arange(len(slow)), atol=1e-12)
    np.testing.assert_allclose(found.value, 101013 + 100 * slow, atol=0.01)  # of what the file's digits leave
    assert len(trace.time) == 4000
    assert trace.channels["x_d"].value.shape == (4000,)


def test_a_pressure_that_drives_a_rod_may_have_no_gap(load):
    trace = load(_recorded(_noisy(lowest=-600.0)))
    sentence = r"what drives this model must be valid throughout, but p_act is not from 0\.48\d to 2\.0\d+ s; cut"
    with pytest.raises(vgtjax.InputError, match=sentence):
        vgtjax.simulate(vgtjax.MechanicalActuator(), trace)
