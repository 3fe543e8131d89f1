"""Readers that come from outside of the package: registered by a script, or offered by an installed package."""

import sys

import numpy as np
import pytest
from commands import run_command
from python_blocks import python_block

import vgtjax
import vgtjax.traces.files._open as readers
from vgtjax.traces import Entry, Record, Recording, register_reader, trace_suffixes


class Numbers(Recording):
    """Duty and time of nothing at all."""

    def __init__(self, path):
        self.path = path
        self.entries = [Entry("time", "s"), Entry("pwm", "%")]

    def read(self, entry):
        return Record(np.arange(5) * (1e-3 if entry.name == "time" else 10.0))


@pytest.fixture(autouse=True)
def forgotten(monkeypatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(readers, "READERS", dict(readers.READERS))
    readers._installed.cache_clear()
    yield
    readers._installed.cache_clear()


@pytest.fixture
def package(monkeypatch, tmp_path):
    """Installs a package with the manual's reader in its module, and the entry point that is given."""

    def install(point: str) -> None:
        text = python_block("docs/extending.md", "NPZRecording")
        (tmp_path / "mine_npz.py").write_text(text.replace('register_reader(".npz", NPZRecording)\n', ""))
        info = tmp_path / "mine_npz-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mine-npz\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[vgtjax.readers]\n{point}\n")
        monkeypatch.syspath_prepend(tmp_path)

    yield install
    sys.modules.pop("mine_npz", None)


def save(path):
    """A run whose position and pressure follow a duty."""
    time = np.arange(0.0, 0.5, 1e-3)
    columns = {"pwm [%]": np.where(time < 0.1, 0.0, 50.0), "p_act [Pa absolute]": np.full_like(time, 1e5)}
    np.savez(path, **{"time [s]": time, "x_d [mm]": time, **columns})


def test_a_registered_reader_reads_in_any_case(tmp_path):
    register_reader(".NUM", Numbers)
    (tmp_path / "run.Num").touch()
    trace = vgtjax.load_trace(tmp_path / "run.Num")
    np.testing.assert_array_equal(trace.pwm, [0, 10, 20, 30, 40])
    assert trace_suffixes()[-1] == ".num"


@pytest.mark.parametrize(
    ("suffix", "sentence"),
    [
        ("npz", "a reader is for a suffix like '.npz', but 'npz' is none; correct it"),
        (".a.b", "a reader is for a suffix like '.npz', but '.a.b' is none; correct it"),
        (".CSV", "files with '.csv' have a reader already; give yours another suffix"),
        (".mat", "files with '.mat' have a reader already; give yours another suffix"),
    ],
)
def test_what_can_not_be_registered(suffix, sentence):
    with pytest.raises(vgtjax.InputError) as refused:
        register_reader(suffix, Numbers)
    assert str(refused.value) == sentence


def test_studies_read_what_an_installed_package_offers(package, tmp_path):
    package("npz = mine_npz:NPZRecording")
    save(tmp_path / "run.npz")
    (tmp_path / "study.toml").write_text('[[trace]]\nfile = "rum.npz"\n')
    refused = run_command("simulate", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert (refused.status, "did you mean 'run.npz'?" in refused.err) == (2, True)
    (tmp_path / "study.toml").write_text('[[trace]]\nfile = "run.npz"\n')
    done = run_command("simulate", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    assert (tmp_path / "out" / "run.csv").is_file()


def test_a_script_goes_before_an_installed_package(package, tmp_path):
    package("npz = mine_npz:NPZRecording")
    register_reader(".npz", Numbers)
    save(tmp_path / "run.npz")
    assert len(vgtjax.load_trace(tmp_path / "run.npz").time) == 5


def test_a_package_that_lacks_its_reader_says_so(package, tmp_path):
    package("npz = mine_npz:Nothing")
    save(tmp_path / "run.npz")
    with pytest.raises(vgtjax.InputError, match=r"^run.npz: its reader mine_npz:Nothing can't be imported \("):
        vgtjax.load_trace(tmp_path / "run.npz")
