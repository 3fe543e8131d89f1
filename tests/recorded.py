"""One small campaign, written as every kind of file that is read."""

import dataclasses
import pathlib
import warnings
from collections.abc import Callable

import asammdf
import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow
import pyarrow.parquet
import scipy.io

import vgtjax

COUNT = 41
UNITS = {"pwm": "%", "p_act": "mbar gauge", "p_res": "mbar gauge", "x_d": "mm"}
STEPS = {"pwm": 0.5, "p_act": 0.1, "p_res": 0.5, "x_d": 0.01}
"""What one count of each channel's converter is worth."""


@dataclasses.dataclass(frozen=True)
class Signal:
    """Counts of a converter at times in s; `unit` is what the file says."""

    time: np.ndarray
    counts: np.ndarray
    step: float
    unit: str | None
    invalid: np.ndarray | None = None

    @property
    def value(self) -> np.ndarray:
        """Counts times what one is worth, as a converter's record says."""
        return self.counts * self.step


Campaign = dict[str, Signal]


def campaign(slow: int = 1) -> Campaign:
    """A duty step and what follows; position and reservoir every `slow` samples."""
    row = np.arange(COUNT)
    counts = {
        "pwm": np.where(row > 4, 100, 0),
        "p_act": -20 * row,
        "p_res": np.full(COUNT, -1600),
        "x_d": 3 * row,
    }
    every = {"pwm": 1, "p_act": 1, "p_res": slow, "x_d": slow}
    return {
        name: Signal(row[:: every[name]] * 1e-3, counts[name][:: every[name]].astype("i2"), STEPS[name], UNITS[name])
        for name in counts
    }


def by_clock(signals: Campaign) -> dict[str, Campaign]:
    """Signals of one clock together, as loggers group them."""
    groups: dict[str, Campaign] = {}
    for name, signal in signals.items():
        groups.setdefault(f"every_{len(signal.time)}", {})[name] = signal
    return groups


def write_csv(path: pathlib.Path, signals: Campaign) -> None:
    """One clock only."""
    header = ",".join(["time [s]", *(f"{name} [{signal.unit}]" for name, signal in signals.items())])
    columns = [next(iter(signals.values())).time, *(signal.value for signal in signals.values())]
    rows = [",".join(f"{cell:.10g}" for cell in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")


def write_mdf(path: pathlib.Path, signals: Campaign) -> None:
    """Raw counts with a linear conversion, a group a clock; MDF 4 for `.mf4`, else MDF 3."""
    with asammdf.MDF(version="4.10" if path.suffix == ".mf4" else "3.30") as file:
        for name, group in by_clock(signals).items():
            file.append([mdf_signal(*pair) for pair in group.items()], comment=name)
        file.save(path, overwrite=True)


LOGGED = {
    "pwm": ("DutyCycle", "%", 0.01, 1),
    "p_act": ("P_Chamber", "mbar", 0.05, 1),
    "p_res": ("P_Vacuum", "mbar", 0.05, 1),
    "x_d": ("Position", "mm", 5e-4, 2),
}
"""Name and unit in the recordings of the example, what a count is worth, and every how many samples there is one."""


def write_logged(path: pathlib.Path, trace: vgtjax.Trace) -> None:
    """A trace of the example as a logger would have recorded it; so `calibrate/example/logger` was made."""
    units = {"%": 1.0, "mbar": 100.0, "mm": 1e-3}
    groups: dict[int, list[asammdf.Signal]] = {}
    for signal, (name, unit, step, every) in LOGGED.items():
        gauge = vgtjax.traces.STANDARD_ATMOSPHERE if unit == "mbar" else 0.0
        channel = trace.channels[signal]
        counts = np.round((channel.value[::every] - gauge) / units[unit] / step).astype("i2")
        groups.setdefault(every, []).append(mdf_signal(name, Signal(channel.time[::every], counts, step, unit)))
    with asammdf.MDF(version="4.10") as file:
        for group in groups.values():
            file.append(group, comment="simulated, with sensor noise")
        file.save(path, overwrite=True, compression=2)


def mdf_signal(name: str, signal: Signal) -> asammdf.Signal:
    """Counts with their conversion, or else floating-point numbers."""
    is_count = signal.counts.dtype.kind == "i"
    return asammdf.Signal(
        samples=signal.counts if is_count else signal.value,
        timestamps=signal.time,
        name=name,
        unit=signal.unit or "",
        conversion={"a": signal.step, "b": 0.0} if is_count else None,
        invalidation_bits=signal.invalid,
    )


def write_tdms(path: pathlib.Path, signals: Campaign) -> None:
    """Waveforms where their clock is even, and else a channel of times."""
    with nptdms.TdmsWriter(path) as file:
        for group, members in by_clock(signals).items():
            time = next(iter(members.values())).time
            even = len(time) > 1 and np.allclose(np.diff(time), time[1] - time[0], rtol=1e-9, atol=0)
            clock = {"wf_increment": time[1] - time[0], "wf_start_offset": time[0]} if even else {}
            channels = [] if even else [nptdms.ChannelObject(group, "time", time, {"unit_string": "s"})]
            for name, signal in members.items():
                stated = {} if signal.unit is None else {"unit_string": signal.unit}
                channels.append(nptdms.ChannelObject(group, name, signal.value, clock | stated))
            file.write_segment(channels)


def write_mat(path: pathlib.Path, signals: Campaign) -> None:
    """A struct a clock, version 5."""
    structs = {group: _struct(members) for group, members in by_clock(signals).items()}
    scipy.io.savemat(path, structs)


def write_mat_73(path: pathlib.Path, signals: Campaign) -> None:
    """The same as HDF5."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for group, members in by_clock(signals).items():
            for name, values in _struct(members).items():
                file.create_dataset(f"{group}/{name}", data=values[None, :]).attrs["MATLAB_class"] = b"double"
            file[group].attrs["MATLAB_class"] = b"struct"
    with path.open("r+b") as block:
        block.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _struct(members: Campaign) -> dict[str, np.ndarray]:
    time = next(iter(members.values())).time
    return {"time": time, **{name: signal.value for name, signal in members.items()}}


def write_timetable(path: pathlib.Path, signals: Campaign, version: str) -> None:
    """A timetable a clock, with the units of its variables left out."""
    frames = {}
    for group, members in by_clock(signals).items():
        time = next(iter(members.values())).time
        index = pd.TimedeltaIndex(np.round(time * 1e6).astype("m8[us]"), name="Time")
        frames[group] = pd.DataFrame({name: signal.value for name, signal in members.items()}, index=index)
    save_frames(path, frames, version)


def save_frames(path: pathlib.Path, frames: dict[str, pd.DataFrame], version: str = "v7") -> None:
    """Tables and timetables of MATLAB, by name."""
    with warnings.catch_warnings():
        # mat-io sets an option of pandas that is deprecated, and says that it chose the format of durations.
        warnings.simplefilter("ignore")
        import matio

        matio.save_to_mat(str(path), frames, version=version)


def write_parquet(path: pathlib.Path, signals: Campaign) -> None:
    """One table; a channel has a null where it was not sampled."""
    time = max((signal.time for signal in signals.values()), key=len)
    columns = {"time [s]": pyarrow.array(time)}
    for name, signal in signals.items():
        values: list[float | None] = [None] * len(time)
        values[:: (len(time) - 1) // (len(signal.time) - 1)] = signal.value.tolist()
        header = name if signal.unit is None else f"{name} [{signal.unit}]"
        columns[header] = pyarrow.array(values, pyarrow.float64())
    pyarrow.parquet.write_table(pyarrow.table(columns), path)


WRITERS: dict[str, Callable[[pathlib.Path, Campaign], None]] = {
    "run.csv": write_csv,
    "run.mf4": write_mdf,
    "run.mdf": write_mdf,
    "run.tdms": write_tdms,
    "run.mat": write_mat,
    "run_73.mat": write_mat_73,
    "run.parquet": write_parquet,
}
"""By the name of the file that each writes."""


def sources_for(path: pathlib.Path, signals: Campaign) -> dict[str, vgtjax.Source] | None:
    """The map that a file needs: MATLAB states no units."""
    if path.suffix != ".mat":
        return None
    return {name: vgtjax.Source(unit=signal.unit) for name, signal in signals.items() if name in UNITS}
