"""The command `compare` where the force of exhaust gas changes sides with direction: no turbine makes that."""

import numpy as np
import pytest
from commands import read, run_command
from support import optimised, quick_nozzle

import vgtjax
from calibrate.compare import alternatives

STUDY = """model = "mechanical"
[components]
vane_force = "turbine"
[[trace]]
file = "loop_*.csv"
[fit]
free = ["diaphragm.preload", "diaphragm.stiffness", "friction.coulomb_force"]
"""
SECONDS = 4.0


def write_loop(folder, gauge):
    """A slow loop of a rod whose vanes are pushed back whichever way they go, as a bench records it."""
    time = np.arange(0, SECONDS, 0.01)
    pressure = -60e3 * np.clip(1 - np.abs(2 * time / SECONDS - 1), 0, 1)
    angles = np.linspace(1.0, 0.6, 6)
    force = vgtjax.HysteresisMap(
        closing=np.outer([2.5, 5.0], angles).ravel(), opening=-np.outer([2, 4], angles).ravel()
    )
    inputs = {"p_act": 101013.0 + pressure, "p_trb": np.full_like(time, gauge), "x_d": np.zeros_like(time)}
    x_d = vgtjax.simulate(vgtjax.MechanicalActuator(vane_force=force), vgtjax.Trace(time, **inputs)).x_d
    seen = 1e3 * np.asarray(x_d) + 8e-3 * np.random.default_rng(int(gauge)).normal(size=time.size)
    columns = np.column_stack([time, pressure, inputs["p_trb"], seen])
    head = "time [s],p_act [Pa gauge],p_trb [Pa gauge],x_d [mm]"
    np.savetxt(folder / f"loop_{gauge:.0f}.csv", columns, fmt="%.6f", delimiter=",", header=head, comments="")


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    with pytest.MonkeyPatch.context() as patch, optimised(), quick_nozzle():
        patch.setattr(alternatives, "VANE_FORCE", ("map",))
        patch.setattr(alternatives, "FRICTION", ("lugre",))
        for gauge in (0.0, 1.5e5, 3.0e5):
            write_loop(folder, gauge)
        (folder / "study.toml").write_text(STUDY)
        outcome = run_command("compare", folder / "study.toml", "--out", folder / "out")
    assert (outcome.status, outcome.err) == (0, "")
    return read(folder / "out" / "summary.json")


def test_the_turbine_is_rejected(compared):
    assert (compared["chosen"]["vane_force"], compared["decided"]["vane_force"]) == ("map", True)
    turbine = next(row for row in compared["table"] if row["name"] == "turbine")
    assert turbine["doubt"] == ""
    assert turbine["difference"] > 1e4  # 2 to 5 N of 5 to 20 um each, in noise of 8 um


def test_the_map_is_found_although_the_turbine_is_nowhere_near(compared):
    """Its fit begins where the study does, not where the turbine's fit took springs to make up for its force."""
    best = next(row for row in compared["table"] if row["name"] == "map")
    assert best["score"] == pytest.approx(1.0, abs=0.2)  # of 2400 samples of noise, each trace left out
