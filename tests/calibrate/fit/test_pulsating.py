"""A rod that felt a pulsating gas force is fitted with the engine that made it pulsate, from a slow sensor's record."""

import numpy as np
import pytest
from commands import read, run_command

import vgtjax
from vgtjax.exhaust import Engine, OperatingPoint, PressurePulsation

NOISE = {"x_d": 3e-6, "p_act": 30.0}  # m, Pa
STUDY = """[[trace]]
file = "gas.csv"
[components]
vane_force = "polynomial"
[fit]
free = ["diaphragm.stiffness", "diaphragm.preload"]
loss = "gaussian"
profiles = "none"
[fit.unknown]
duty_delay = false
duty_hold = false
noise = "white"
[pulsation]
engine_speed = 1000
[parameters]
"diaphragm.stiffness" = {value = 12600}
"""


@pytest.fixture(scope="module")
def recorded():
    """What the rod did under a pulsating pressure and what it would have done under its mean, with that mean."""
    time = np.arange(0, 1.2, 1e-3)
    duty = np.select([time < 0.1, time < 0.6], [0.0, 70.0], 45.0)
    slow = vgtjax.Trace(time, pwm=duty, p_res=np.full_like(time, 2e4), p_trb=np.full_like(time, 8e4))
    point = OperatingPoint(1000.0, 0.476e-3, 1150.0, 1.03e5, 87e-6)
    felt = PressurePulsation.of(Engine(), point).applied(slow)
    truth = vgtjax.Actuator(vane_force=vgtjax.ForcePolynomial())
    pulsating, steady = vgtjax.simulate(truth, felt), vgtjax.simulate(truth, slow)
    rows, noise = np.searchsorted(felt.time, time), np.random.default_rng(0)
    signals = {name: np.asarray(getattr(pulsating, name))[rows] for name in NOISE}
    apart = float(np.sqrt(np.mean((signals["x_d"] - np.asarray(steady.x_d)) ** 2)))
    noisy = {name: values + noise.normal(size=len(time), scale=NOISE[name]) for name, values in signals.items()}
    return slow.replace(**noisy), apart


def to_csv(trace):
    header = "time [s],pwm [%],p_res [Pa absolute],p_trb [Pa gauge],x_d [m],p_act [Pa absolute]"
    columns = (trace.time, trace.pwm, trace.p_res, trace.p_trb, trace.x_d, trace.p_act)
    return "\n".join([header, *(",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True))])


def test_the_truth_is_found_again(recorded, tmp_path):
    trace, apart = recorded
    assert apart > 10 * NOISE["x_d"]  # pulsation matters: without it nothing would be found
    (tmp_path / "gas.csv").write_text(to_csv(trace))
    (tmp_path / "study.toml").write_text(STUDY)
    assert run_command("fit", tmp_path / "study.toml", "--out", tmp_path / "out").status == 0
    parameters = read(tmp_path / "out" / "parameters.json")["parameters"]
    for name, true in (("diaphragm.stiffness", 12000.0), ("diaphragm.preload", 49.46)):
        fitted = parameters[name]
        assert abs(fitted["value"] - true) < 4 * fitted["std_error"]  # Gaussian: once in 16000
        assert fitted["std_error"] < 1e-3 * true
    found = read(tmp_path / "out" / "summary.json")["traces"]["gas"]["rmse"]
    assert found["x_d"] == pytest.approx(NOISE["x_d"], rel=0.1)  # 1200 samples: 2 % is one deviation
