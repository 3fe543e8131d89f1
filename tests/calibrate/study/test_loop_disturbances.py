"""`[control]` of a study says what disturbs its closed loops, and each of them gets it."""

import pathlib
import re
import tomllib

import numpy as np
import pytest
from commands import assert_refused, run_command

from calibrate.control.job import prepare_control
from calibrate.study.tables import AnyStudy
from calibrate.tune.job import prepare_tuning, variants_of
from vgtjax import InputError
from vgtjax.control import (
    CoilSupply,
    ConstantDuty,
    LateDuty,
    LostSensor,
    Sensors,
    StuckSensor,
    TurbinePulsation,
    WithFallback,
)

MANUAL = pathlib.Path(__file__).parents[3] / "docs" / "control.md"
STUDY = """
[pulsation]
engine_speed = 1200
amplitude = 0.1
[control]
design = "pi"
duration = 0.2
settled = 0.1
duty_delay = 0.004
fallback = "static-balance"
[control.reservoir]
level = 25000.0
depth = 4000.0
times = [0.1]
[control.sensor]
position = {offset = 1e-4, quantum = 1e-5}
[[control.reference]]
kind = "sine"
amplitude = 0.001
rate = 70.0
offset = 0.005
"""
KINDS = """
[[control.disturbance]]
kind = "coil-supply"
factor = 0.9
[[control.disturbance]]
kind = "coil-supply"
factor = [1.0, 0.8]
times = [1.0, 2.0]
[[control.disturbance]]
kind = "pulsation"
amplitude = 0.2
frequency = 67.0
[[control.disturbance]]
kind = "stuck-sensor"
begin = 0.1
end = 0.2
[[control.disturbance]]
kind = "lost-sensor"
sensor = "reservoir"
begin = 0.3
value = 1000.0
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY + KINDS, encoding="utf-8")
    return tmp_path / "study.toml"


def test_the_manuals_study_is_one():
    (text,) = re.findall(r"```toml\n(.*?)```", MANUAL.read_text(encoding="utf-8"), flags=re.DOTALL)
    study = AnyStudy.validate_python(tomllib.loads(text))
    kinds = [type(each) for each in variants_of(study)[""].disturbances]
    assert kinds == [TurbinePulsation, CoilSupply, LostSensor, LateDuty]


def test_a_study_disturbs_every_loop(path):
    (cases,) = prepare_control(path, None, None).groups
    engine, weak, sagging, sine, stuck, lost, late = cases.scenarios.disturbances
    kinds = [TurbinePulsation, CoilSupply, CoilSupply, TurbinePulsation, StuckSensor, LostSensor, LateDuty]
    assert [type(each) for each in cases.scenarios.disturbances] == kinds
    assert np.ptp(engine.share.values) == pytest.approx(0.2)
    assert weak.factor.level == 0.9
    np.testing.assert_array_equal(sagging.factor.levels, [[1.0, 0.8]])
    assert (sine.share.amplitude, sine.share.rate) == (0.2, 2 * np.pi * 67.0)
    assert (stuck.channel, stuck.begin, stuck.end) == ("position", 0.1, 0.2)
    assert (lost.channel, lost.begin, lost.end, lost.value) == ("reservoir", 0.3, np.inf, 1000.0)
    assert late.delay == 0.004


def test_variants_of_a_study_differ_by_what_they_state(path):
    more = """
[[control.variant]]
name = "in time"
duty_delay = 0.0
[[control.variant]]
name = "off"
sensor = {position = {offset = 5e-5}}
"""
    path.write_text(STUDY + KINDS + more, encoding="utf-8")
    (cases,) = prepare_control(path, None, None).groups
    names = ["", "in time", "off"]
    assert [label.variant for label in cases.labels] == names * (len(cases) // 3)
    np.testing.assert_array_equal(cases.scenarios.disturbances[-1].delay[:3], [0.004, 0.0, 0.004])
    np.testing.assert_array_equal(cases.scenarios.sensors.position.offset[:3], [1e-4, 1e-4, 5e-5])
    twice = more.replace('"off"', '"in time"')
    path.write_text(STUDY + KINDS + twice, encoding="utf-8")
    with pytest.raises(InputError, match="two variants are named 'in time'; give each a name of its own"):
        prepare_control(path, None, None)


def test_a_study_has_its_reservoir_and_sensors(path):
    (cases,) = prepare_control(path, None, None).groups
    vacuum, position = cases.scenarios.reservoir, cases.scenarios.sensors.position
    assert (vacuum.level, vacuum.depth, vacuum.recovery) == (25_000.0, 4000.0, 0.5)
    assert (position.offset, position.quantum) == (1e-4, 1e-5)
    assert position.noise == Sensors.bench().position.noise


def test_loops_are_tuned_under_what_disturbs_them(path):
    job = prepare_tuning(path, None)
    assert len(job.true.cases.scenarios.disturbances) == 7
    assert "gains are tuned without the fallback" in job.notes


def test_a_fallback_knows_what_the_controller_knows(path):
    (guarded,) = prepare_control(path, None, None).controllers.values()
    assert isinstance(guarded, WithFallback)
    assert not isinstance(guarded.fallback, ConstantDuty)
    assert float(guarded.highest) == pytest.approx(float(guarded.fallback.diaphragm.travel) + 5e-4)


def test_a_sensor_without_noise_may_stand_still(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('[control]\ndesign = "pi"\nfallback = "static-balance"\nsensors = "ideal"\n', encoding="utf-8")
    (guarded,) = prepare_control(path, None, None).controllers.values()
    assert float(guarded.patience) == np.inf


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (
            'kind = "coil-supply"\nfactor = [1.0, 0.8]',
            "a coil-supply needs one factor, or a list with a time for each, but there are 0 times for 2; give e.g. "
            "factor = [1.0, 0.8] and times = [2.0, 3.0]",
        ),
        (
            'kind = "lost-senser"\nbegin = 1.0',
            "control.disturbance.kind must be one of coil-supply, pulsation, stuck-sensor, lost-sensor, but it is "
            "'lost-senser'; did you mean 'lost-sensor'?",
        ),
        (
            'kind = "stuck-sensor"',
            "the key 'control.disturbance.begin' is missing, which kind = 'stuck-sensor' needs; add it",
        ),
        (
            'kind = "stuck-sensor"\nbegin = 1.0\nend = 0.5',
            "the end of a stuck-sensor must be after its begin, but it is 0.5 s; correct it",
        ),
        (
            'kind = "stuck-sensor"\nbegin = 1.0\nvalue = 2.0',
            "the key 'control.disturbance.value' belongs to kind = 'lost-sensor', but it is 'stuck-sensor'; remove the "
            "key",
        ),
    ],
)
def test_bad_disturbances_get_one_sentence(more, sentence, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(f"[[control.disturbance]]\n{more}\n", encoding="utf-8")
    assert_refused(run_command("control", path, "--out", tmp_path / "out"), f"study.toml: {sentence}", tmp_path / "out")


def test_a_late_duty_has_its_limit(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text("[control]\nduty_delay = 0.1\n", encoding="utf-8")
    sentence = "study.toml: control.duty_delay: Input should be less than or equal to 0.02, but it is 0.1; correct it"
    assert_refused(run_command("control", path, "--out", tmp_path / "out"), sentence, tmp_path / "out")


@pytest.mark.parametrize(
    ("reservoir", "place"),
    [
        ("{drift = -9000.0}", "-16000 Pa absolute 4 s into a run of 4 s"),
        ("{times = [1.0], depth = -30000.0}", "-10000 Pa absolute 1 s into a run of 4 s"),
        # A period of the sine and what settles before it.
        ("{drift = -2500.0}", "-707.5 Pa absolute 8.283 s into a run of 8.28319 s"),
    ],
)
def test_a_vacuum_below_zero_is_refused(reservoir, place, tmp_path):
    path = tmp_path / "study.toml"
    kind = 'kind = "sine"\namplitude = 1e-3\nrate = 1.0\noffset = 5e-3\n'
    if "of 4 s" in place:
        kind = 'kind = "steps"\ntimes = [0.5]\nlevels = [4e-3]\n'
    reference = f"[[control.reference]]\n{kind}"
    path.write_text(f"[control]\nduration = 4.0\nreservoir = {reservoir}\n{reference}", encoding="utf-8")
    sentence = (
        f"study.toml: the reservoir must stay at a pressure of zero or more, but it comes to {place}; correct its "
        "drift, which is in Pa/s, or its depth"
    )
    assert_refused(run_command("control", path, "--out", tmp_path / "out"), sentence, tmp_path / "out")
