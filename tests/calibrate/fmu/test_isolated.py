"""An FMU without this package: its source is compiled and run by a process that has the standard library only."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from support import EXAMPLE

import vgtjax
from calibrate.fmu import compilers, package
from calibrate.fmu.plant import plant_unit

from .opened import own_only
from .variants import build

RUN = r"""
import ctypes, importlib.util, json, os, re, subprocess, sys, time, zipfile
assert not any(importlib.util.find_spec(name) for name in ("vgtjax", "calibrate", "jax", "numpy"))
path, compiler, *flags = json.loads(sys.argv[1])
rows = json.load(sys.stdin)
archive = zipfile.ZipFile(path)
text = archive.read("modelDescription.xml").decode()
open("model.c", "wb").write(archive.read("sources/vgtjax_actuator.c"))
subprocess.run([compiler, *flags, "-o", "model.so", "model.c", "-lm"], check=True)
library = ctypes.CDLL(os.path.abspath("model.so"))
places = {name: int(at) for name, at in re.findall(r'name="([^"]+)"\s+valueReference="(\d+)"', text)}
allocate = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t)
class Callbacks(ctypes.Structure):
    _fields_ = [("logger", ctypes.c_void_p), ("allocate", allocate), ("free", ctypes.c_void_p)] + [
        (name, ctypes.c_void_p) for name in ("finished", "environment")
    ]
kept = []
def memory(count, size):
    kept.append(ctypes.create_string_buffer(count * size))
    return ctypes.addressof(kept[-1])
callbacks = Callbacks(allocate=allocate(memory))
library.fmi2Instantiate.restype = ctypes.c_void_p
guid = re.search('guid="([^"]+)"', text)[1].encode()
unit = ctypes.c_void_p(library.fmi2Instantiate(b"one", 1, guid, b"", ctypes.byref(callbacks), 0, 0))
def reference(name):
    return (ctypes.c_uint * 1)(places[name])
def give(name, value, rate):
    assert library.fmi2SetReal(unit, reference(name), ctypes.c_size_t(1), (ctypes.c_double * 1)(value)) == 0
    order = (ctypes.c_int * 1)(1)
    one = ctypes.c_size_t(1)
    assert library.fmi2SetRealInputDerivatives(unit, reference(name), one, order, (ctypes.c_double * 1)(rate)) == 0
def take(name):
    found = (ctypes.c_double * 1)()
    assert library.fmi2GetReal(unit, reference(name), ctypes.c_size_t(1), found) == 0
    return found[0]
library.fmi2EnterInitializationMode(unit)
found = []
for number, (duration, *inputs) in enumerate(rows):
    for name, value, rate in inputs:
        give(name, value, rate)
    if number == 0:
        library.fmi2ExitInitializationMode(unit)
    found.append((take("x_d"), take("p_act")))
    assert library.fmi2DoStep(unit, ctypes.c_double(0.0), ctypes.c_double(duration), 1) == 0
print(json.dumps(found))
"""


@pytest.mark.parametrize("name", ["vane-force-map", "static-map-polynomial"])
def test_it_needs_no_python_package(tmp_path, monkeypatch, name):
    monkeypatch.setattr(package, "compilers", own_only)
    model, path = build(name), tmp_path / "unit.fmu"
    path.write_bytes(package.to_fmu(plant_unit(model), name, "0", "2026-01-31"))
    trace = vgtjax.load_trace(EXAMPLE / "step_80.csv").window(0.0, 0.8)
    drive = trace.drive()
    turbine = (
        np.broadcast_to(drive.turbine.start, len(trace.time)),
        np.broadcast_to(drive.turbine.rate, len(trace.time)),
    )
    rows = [
        (
            float(drive.duration[i]),
            ("pwm", float(drive.pwm[i]), 0.0),
            ("p_res", float(drive.reservoir.start[i]), float(drive.reservoir.rate[i])),
            ("p_trb", float(turbine[0][i]), float(turbine[1][i])),
        )
        for i in range(len(trace.time))
    ]
    given = json.dumps([str(path), compilers.own_compiler(), "-fPIC", *compilers.FLAGS])
    command = [sys.executable, "-I", "-S", "-c", RUN, given]  # isolated, and without the packages of a site
    done = subprocess.run(command, input=json.dumps(rows), capture_output=True, text=True, cwd=tmp_path, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    x_d, p_act = np.array(json.loads(done.stdout)).T
    solution = vgtjax.simulate(model, trace)
    np.testing.assert_allclose(x_d, solution.x_d, rtol=0, atol=1e-9)
    np.testing.assert_allclose(p_act, solution.p_act, rtol=0, atol=1e-6)
    assert np.ptp(x_d) > 5e-3
    assert pathlib.Path(tmp_path / "model.so").exists()
