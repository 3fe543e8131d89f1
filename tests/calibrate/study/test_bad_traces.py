"""A bad trace ends a command before it writes anything."""

import pytest
from bad_traces import BAD_TRACES, BadTrace, text, without_column
from commands import assert_refused, run_command

MISSING = "the column is missing; add a column"
STATE = "or state in channels which column is which"


@pytest.mark.parametrize("case", BAD_TRACES.values(), ids=BAD_TRACES.keys())
def test_a_fit_refuses_a_bad_trace(folder, fit, case: BadTrace):
    (folder / "bench.csv").write_bytes(case.raw)
    assert_refused(fit(), f"bench.csv, {case.sentence}", folder / "out")


def test_a_simulation_refuses_a_bad_trace(folder):
    (folder / "bench.csv").write_bytes(BAD_TRACES["time runs back"].raw)
    outcome = run_command("simulate", folder / "study.toml", "--out", folder / "out")
    assert_refused(outcome, f"bench.csv, {BAD_TRACES['time runs back'].sentence}", folder / "out")


def test_a_trace_that_only_validates_must_be_good_too(folder, fit):
    (folder / "other.csv").write_bytes(BAD_TRACES["infinity"].raw)
    with (folder / "study.toml").open("a") as study:
        study.write('[[trace]]\nfile = "other.csv"\nuse = "validate"\n')
    assert_refused(fit(), f"other.csv, {BAD_TRACES['infinity'].sentence}", folder / "out")


def test_the_file_is_named_even_where_the_study_names_the_trace(folder, fit):
    (folder / "bench.csv").write_bytes(BAD_TRACES["infinity"].raw)
    (folder / "study.toml").write_text('[[trace]]\nfile = "bench.csv"\nname = "first"\n')
    assert_refused(fit(), f"bench.csv, {BAD_TRACES['infinity'].sentence}", folder / "out")


def test_a_fit_needs_something_measured(folder, fit):
    (folder / "bench.csv").write_text("time [s],pwm [%]\n0,0\n0.001,0\n0.002,0\n")
    assert_refused(
        fit(),
        f"bench.csv, line 1, column x_d or p_act: {MISSING} 'x_d [mm]' or 'p_act [mbar gauge]', {STATE}",
        folder / "out",
    )


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (without_column("x_d"), f"bench.csv, line 1, column x_d: {MISSING} 'x_d [mm]', {STATE}"),
        (
            without_column("p_act"),
            f"bench.csv, line 1, column p_act or f_drive: {MISSING} 'p_act [mbar gauge]' or 'f_drive [N]', {STATE}",
        ),
    ],
)
def test_the_mechanical_model_needs_position_and_pressure_or_force(folder, fit, content, sentence):
    (folder / "bench.csv").write_text(content)
    (folder / "study.toml").write_text('model = "mechanical"\n[[trace]]\nfile = "bench.csv"\n')
    assert_refused(fit(), sentence, folder / "out")


def test_the_atmosphere_of_the_trace_decides_what_is_below_vacuum(folder, fit):
    (folder / "bench.csv").write_text(text().replace("-800.0", "-1000"))
    with (folder / "study.toml").open("a") as study:
        study.write("atmosphere = 90000\n")
    sentence = (
        "bench.csv, line 2, column p_res: -1000 [mbar gauge] is outside what sensor and physics allow (-5000 to 95000 "
        "Pa absolute); check the sensor, its unit, and gauge against absolute"
    )
    assert_refused(fit(), sentence, folder / "out")
