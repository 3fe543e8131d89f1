"""The study that the file format's documentation prints, and the promise that nothing is compiled twice."""

import os
import shutil
import subprocess
import sys
import tomllib

import pytest
from study_text import HEAD
from support import EXAMPLE

import vgtjax
from calibrate.study.models import build_model, start_values
from calibrate.study.tables import AnyStudy
from vgtjax.estimation import plan_task
from vgtjax.parameters import build_transform

PRINTED = f"""{HEAD}[[trace]]
file = "levels_1.csv"
use = "fit"
name = "levels_1"
unit = "unit_a"
atmosphere = 101013
window = [0.0, 12.0]
[fit]
free = ["diaphragm.*", "friction.*"]
fixed = ["diaphragm.area"]
[parameters]
"diaphragm.stiffness" = {{value = 11500, lower = 8000, upper = 16000}}
"""


def test_the_printed_study_is_a_task():
    """It frees `diaphragm.damping` too, which starts at zero."""
    study = AnyStudy.validate_python(tomllib.loads(PRINTED))
    model = build_model(study)
    values, bounds = start_values(model, study.parameters)
    trace = vgtjax.load_trace(EXAMPLE / "levels_1.csv").window(*study.trace[0].window)
    task = plan_task(model, [trace], free=study.fit.free, fixed=study.fit.fixed, values=values, bounds=bounds)
    assert "diaphragm.damping" in task.selection.entries
    assert "diaphragm.area" not in task.selection.entries
    start = task.selection.pack(task.model)
    assert build_transform(vgtjax.parameter_table(model), task.selection.entries, start, task.bounds)


WHOLE = """name = "unit A"
model = "full"
[components]
vane_force = "speed-map"
[channels.p_act]
name = "P_act_raw"
unit = "mbar gauge"
group = 2
scale = 1.0
offset = 0.0
[[trace]]
file = "a.mf4"
duty_delay = 0.004
duty_hold = "linear"
gain = {x_d = 1.01}
[fit]
loss = "evidence"
starts = 1
profiles = "flagged"
posterior = 0
[fit.unknown]
duty_delay = "evidence"
duty_hold = "evidence"
gain = []
offset = ["x_d", "p_act"]
start_state = "evidence"
noise = "evidence"
[parameters]
"diaphragm.area" = {deviation = 2.9e-5}
"diaphragm.mass" = {value = 0.63, relative = 0.05}
[report]
title = "Calibration of unit A"
[[report.sensor]]
channel = "x_d"
uncertainty = 2e-6
[pulsation]
engine_speed = 1000
[control]
design = "adaptive-position"
belief = "printed"
duty_delay = 0.0
"""


def test_a_study_with_every_promised_key_is_read():
    study = AnyStudy.validate_python(tomllib.loads(WHOLE))
    assert (study.fit.posterior, study.fit.unknown.start_state) == (0, "evidence")
    assert study.fit.unknown.offset == ["x_d", "p_act"]
    assert build_model(study) is not None


@pytest.mark.parametrize("command", ["simulate"])
def test_a_second_run_compiles_nothing(command, tmp_path):
    """The second process finds every program in the cache and adds none."""
    study = tmp_path / "study.toml"
    shutil.copy(EXAMPLE / "step_50.csv", tmp_path)
    study.write_text('[[trace]]\nfile = "step_50.csv"\nwindow = [0.0, 0.4]\n')
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}

    def programs(out):
        arguments = [sys.executable, "-m", "calibrate", command, str(study), "--out", str(tmp_path / out)]
        subprocess.run(arguments, env=environment, check=True, capture_output=True)
        return {file.name for file in (tmp_path / "cache").rglob("*-cache")}

    first = programs("first")
    assert first
    assert programs("second") == first
