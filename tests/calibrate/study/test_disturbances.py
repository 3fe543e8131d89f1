"""`[pulsation]`: traces pulsate about what their sensors show where the study says so, and nowhere else."""

import numpy as np
import pytest
from bad_traces import text
from commands import assert_refused, run_command

from calibrate.study.units import prepare

HEADER = "time [s],pwm [%],p_act [mbar gauge],p_res [mbar gauge],x_d [mm],p_trb [mbar gauge]"
ROWS = tuple(f"{i / 1000:.3f},0,0.0,-800.0,0.0,900.0" for i in range(121))  # a cycle at 1000 rpm
TRACE = '[[trace]]\nfile = "gas.csv"\n[components]\nvane_force = "polynomial"\n'
PULSATION = f"{TRACE}[pulsation]\nengine_speed = 1000\n"
PRESSURE = 90e3  # Pa gauge


@pytest.fixture
def gas(folder):
    (folder / "gas.csv").write_text(text(HEADER, ROWS))
    return folder


def turbine_pressure(folder, study, **how):
    (folder / "study.toml").write_text(study)
    ((_, trace),) = prepare(folder / "study.toml", None, **how).units[0].traces
    return trace.p_trb


def test_without_the_table_traces_are_what_was_recorded(gas):
    np.testing.assert_array_equal(turbine_pressure(gas, TRACE), np.full(121, 900.0 * 100))


def test_a_trace_pulsates_as_the_engine_does(gas):
    pressure = turbine_pressure(gas, PULSATION)
    assert len(pressure) == 2 * 120 + 1  # 0.5 ms, as 1 ms is less than 40 samples in 30 ms
    assert np.mean(pressure[:-1]) == pytest.approx(PRESSURE, rel=1e-3)  # kinks between samples
    # The engine's own, 1.273 to 1.749 bar about 1.443, in parts of its gauge mean against 1.01013 bar of atmosphere.
    assert np.max(pressure) / PRESSURE == pytest.approx(1 + (1.749 - 1.443) / (1.443 - 1.01013), abs=0.01)
    assert np.min(pressure) / PRESSURE == pytest.approx(1 - (1.443 - 1.273) / (1.443 - 1.01013), abs=0.01)


def test_a_share_and_the_engines_state_change_it(gas):
    shared = turbine_pressure(gas, f"{PULSATION}amplitude = 0.1\n")
    assert 0.5 * np.ptp(shared) == pytest.approx(0.1 * PRESSURE, rel=2e-2)  # a sharp valley between samples
    usual = turbine_pressure(gas, PULSATION)
    assert np.ptp(turbine_pressure(gas, f"{PULSATION}effective_area = 120e-6\n")) > 1.1 * np.ptp(usual)


def test_what_reads_samples_gets_them_as_recorded(gas):
    np.testing.assert_array_equal(turbine_pressure(gas, PULSATION, as_recorded=True), np.full(121, PRESSURE))


def test_simulate_writes_the_pressure_that_acted_at_the_times_that_were_recorded(gas):
    (gas / "study.toml").write_text(PULSATION)
    assert run_command("simulate", gas / "study.toml", "--out", gas / "out").status == 0
    written = np.genfromtxt(gas / "out" / "gas.csv", delimiter=",", names=True, deletechars="")
    np.testing.assert_array_equal(written["time_[s]"], np.arange(121) / 1000)
    acted = turbine_pressure(gas, PULSATION)[::2]
    np.testing.assert_allclose(written["p_trb_[Pa_gauge]"], acted, rtol=6e-9)  # nine digits


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("engine_sped = 1000\n", "unknown key 'pulsation.engine_sped'; did you mean 'engine_speed'?"),
        ("amplitude = 0.2\n", "the key 'pulsation.engine_speed' is missing; add it"),
        (
            "engine_speed = -1000\n",
            "study.toml: pulsation.engine_speed: Input should be greater than or equal to 400, but it is -1000; "
            "correct it",
        ),
        (
            'engine_speed = 1000\namplitude = "engin"\n',
            "pulsation.amplitude must be 'engine' or a share of the mean gauge pressure between 0 and 1, but it is "
            "'engin'; write e.g. 0.2",
        ),
        (
            "engine_speed = 1000\namplitude = 1\n",
            "pulsation.amplitude must be 'engine' or a share of the mean gauge pressure between 0 and 1, but it is 1; "
            "write e.g. 0.2",
        ),
        (
            "engine_speed = 1000\noutlet_pressure = 1.03\n",
            "pulsation.outlet_pressure: Input should be greater than or equal to 30000, but it is 1.03; correct it",
        ),
    ],
    ids=["key", "no speed", "speed", "word", "share", "bar"],
)
def test_a_bad_table_is_refused(gas, table, sentence):
    (gas / "study.toml").write_text(f"{TRACE}[pulsation]\n{table}")
    outcome = run_command("simulate", gas / "study.toml", "--out", gas / "out")
    assert_refused(outcome, f"study.toml: {sentence.removeprefix('study.toml: ')}", gas / "out")


def test_an_engine_without_a_cycle_fails_the_command(gas):
    (gas / "study.toml").write_text(f"{PULSATION}effective_area = 1e-6\n")
    outcome = run_command("simulate", gas / "study.toml", "--out", gas / "out")
    assert outcome.status == 1
    assert "No cycle repeats itself" in outcome.err
    assert not (gas / "out").exists()
