"""Large files of loggers, of which only a few channels are wanted: what it takes to have them."""

import pathlib
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping

import numpy as np

from ..table import Section, seconds

OTHERS = 500
SAMPLES = 25_000
WANTED = {"pwm": "%", "p_act": "Pa absolute", "x_d": "m"}
COLUMNS = ("file", "size MB", "imports", "channels", "memory MB")
READ = """
import re, time
peak = lambda: int(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1]) / 1024  # kB, of Linux
import vgtjax
from vgtjax import Source
begin = time.perf_counter()
for package in {packages}: __import__(package)
opened, before = time.perf_counter(), peak()
trace = vgtjax.load_trace({path!r}, channels={{name: Source(unit=unit) for name, unit in {wanted}.items()}})
print(opened - begin, time.perf_counter() - opened, peak() - before)
"""
Channels = Mapping[str, np.ndarray]


def measure() -> Section:
    """Times the wanted channels of every kind of file, each in a process of its own."""
    section = Section("Files", _ABOUT, COLUMNS)
    rng = np.random.default_rng(0)
    channels = {name: np.full(SAMPLES, 0.5e5 if name == "p_act" else 0.005) for name in WANTED}
    others = {f"other_{i:03d}": rng.standard_normal(SAMPLES) for i in range(OTHERS)}
    time = np.arange(SAMPLES) * 1e-3
    with tempfile.TemporaryDirectory() as folder:
        for name, (write, packages) in KINDS.items():
            path = pathlib.Path(folder, name)
            write(path, time, others | channels)
            size = path.stat().st_size / 1e6
            imports, reading, memory = _read(path, packages)
            section.add(name, f"{size:.0f}", seconds(imports), seconds(reading), f"{memory:.0f}")
            path.unlink()
    return section


_ABOUT = (
    f"{len(WANTED)} mapped channels beside {OTHERS} others of {SAMPLES} samples: time of the packages' imports and of "
    "load_trace, and by how much that raises the peak of the process's memory."
)


def _read(path: pathlib.Path, packages: tuple[str, ...]) -> list[float]:
    code = READ.format(packages=packages, path=str(path), wanted=WANTED)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{path.name} could not be read: {done.stderr.strip()}")
    return [float(word) for word in done.stdout.split()]


def _write_mdf(path: pathlib.Path, time: np.ndarray, channels: Channels) -> None:
    import asammdf

    with asammdf.MDF(version="4.10" if path.suffix == ".mf4" else "3.30") as file:
        file.append([asammdf.Signal(samples=each, timestamps=time, name=name) for name, each in channels.items()])
        file.save(path, overwrite=True)


def _write_tdms(path: pathlib.Path, time: np.ndarray, channels: Channels) -> None:
    import nptdms

    clock = {"wf_increment": time[1] - time[0], "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("fast", name, each, clock) for name, each in channels.items()])


def _write_mat(path: pathlib.Path, time: np.ndarray, channels: Channels) -> None:
    import scipy.io

    scipy.io.savemat(path, {"time": time, **channels}, do_compression=path.stem.endswith("compressed"))


def _write_mat_73(path: pathlib.Path, time: np.ndarray, channels: Channels) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in {"time": time, **channels}.items():
            file[name] = values[None, :]


def _write_parquet(path: pathlib.Path, time: np.ndarray, channels: Channels) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"time [s]": time, **channels}), path)


KINDS: dict[str, tuple[Callable[[pathlib.Path, np.ndarray, Channels], None], tuple[str, ...]]] = {
    "run.mf4": (_write_mdf, ("asammdf",)),
    "run.mdf": (_write_mdf, ("asammdf",)),
    "run.tdms": (_write_tdms, ("nptdms",)),
    "run_5.mat": (_write_mat, ("scipy.io",)),
    "run_7_compressed.mat": (_write_mat, ("scipy.io",)),
    "run_73.mat": (_write_mat_73, ("h5py",)),
    "run.parquet": (_write_parquet, ("pyarrow.parquet",)),
}
"""Writers, and what reading needs, by the name of a file."""
