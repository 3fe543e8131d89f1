"""Units side by side, each in a process of its own."""

import os
import pickle
from multiprocessing import resource_tracker, spawn

import pytest
from commands import cut_example

import vgtjax
from calibrate import workers
from calibrate.output.console import console
from calibrate.study.units import prepare
from calibrate.workers import each_unit

STUDY = '[[trace]]\nfile = "unit_*.csv"\nunit = "{stem}"\n'


def note(job, unit, folder):
    """Says who it is, and leaves its process and its trace behind."""
    import jax

    console.print(f"{unit.name} of {len(job.units)}")
    (trace,) = unit.used("fit")
    folder.mkdir(parents=True)
    (folder / "seen").write_text(f"{os.getpid()} {jax.device_count()} {trace.name} {trace.x_d[0]:.17g}")


def refuse(job, unit, folder):
    """One unit is bad."""
    if unit.name == "unit_2":
        raise vgtjax.InputError("a unit must be good, but this one is bad; mend it", "unit")
    note(job, unit, folder)


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    folder = tmp_path_factory.mktemp("units")
    for number in (1, 2, 3):
        cut_example("step_80", 0.3, folder, f"unit_{number}")
    (folder / "study.toml").write_text(STUDY)
    return prepare(folder / "study.toml", None, to_fit=True)


def test_every_unit_is_done_in_another_process(job, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(workers, "available_memory", lambda: 8 * 2**30)
    folders = [(unit, tmp_path / unit.name) for unit in job.units]
    each_unit(job, folders, note)
    assert sorted(capsys.readouterr().out.splitlines()) == [f"unit_{number} of 3" for number in (1, 2, 3)]
    for unit, folder in folders:
        process, devices, name, first = (folder / "seen").read_text().split()
        assert int(process) != os.getpid()
        assert (int(devices), name) == (1, unit.name)
        assert float(first) == unit.used("fit")[0].x_d[0]


def test_what_is_left_of_several_is_done_alike(job, tmp_path):
    """A resumed run with one unit left computes it on one core, as the others were."""
    each_unit(job, [(job.units[1], tmp_path / "left")], note)
    assert (tmp_path / "left" / "seen").read_text().split()[1:3] == ["1", "unit_2"]


def test_trouble_of_a_unit_comes_home(job, tmp_path):
    folders = [(unit, tmp_path / unit.name) for unit in job.units]
    with pytest.raises(vgtjax.InputError, match="a unit must be good") as caught:
        each_unit(job, folders, refuse)
    assert caught.value.argument == "unit"


def test_a_process_that_dies_before_it_has_begun_is_noticed(job, tmp_path, monkeypatch):
    """Also one that is told of more than a pipe holds, 64 kB."""
    resource_tracker.ensure_running()  # a process of the same program, which lives
    monkeypatch.setattr(spawn, "_python_exe", b"/bin/false")
    assert len(pickle.dumps(job)) > 1 << 16
    with pytest.raises(vgtjax.SimulationError, match="a process of this run was ended"):
        each_unit(job, [(job.units[1], tmp_path / "left")], note)
