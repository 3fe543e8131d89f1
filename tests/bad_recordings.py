"""Campaigns that break one rule each, and the sentence that answers, whatever file they are written as."""

import dataclasses
from collections.abc import Callable

import numpy as np
from recorded import COUNT, UNITS, Campaign


def _with(name: str, **changes: object) -> Callable[[Campaign], Campaign]:
    """Replaces fields of one signal."""
    return lambda signals: signals | {name: dataclasses.replace(signals[name], **changes)}


def _with_value(name: str, sample: int, value: float) -> Callable[[Campaign], Campaign]:
    """Replaces one value of a signal, which is then recorded as floating-point numbers in its unit."""

    def spoil(signals: Campaign) -> Campaign:
        counts = signals[name].value
        counts[sample] = value
        return signals | {name: dataclasses.replace(signals[name], counts=counts, step=1.0)}

    return spoil


def _with_time(sample: int, time: float) -> Callable[[Campaign], Campaign]:
    """Replaces one time of the common clock."""

    def spoil(signals: Campaign) -> Campaign:
        times = next(iter(signals.values())).time.copy()
        times[sample] = time
        return {name: dataclasses.replace(signal, time=times) for name, signal in signals.items()}

    return spoil


def _faster(by: float) -> Callable[[Campaign], Campaign]:
    return lambda signals: {
        name: dataclasses.replace(signal, time=signal.time * by) for name, signal in signals.items()
    }


RANGE = "(-5000 to 106013 Pa absolute); check the sensor, its unit, and gauge against absolute"


@dataclasses.dataclass(frozen=True)
class Spoilt:
    """What breaks a rule, and the sentence that answers, with places that depend on the kind of file."""

    spoil: Callable[[Campaign], Campaign]
    template: str

    def sentence(self, file: str) -> str:
        """What is said of the campaign when it is written under that name."""
        noun, item = ("column", "row") if file == "run.parquet" else ("channel", "sample")
        group = {"run.mf4": "0", "run.mdf": "0", "run.parquet": None}.get(file, f"every_{COUNT}")
        of_group = "" if group is None else f" of group {group}"
        places = {name: f"{noun} {name}{of_group}" for name in ("time", *UNITS)}
        if file in ("run.mf4", "run.mdf"):  # times are a part of the group, whose first channel is named
            places["time"] = places["pwm"]
        clock = places["pwm" if file == "run.tdms" else "time"]  # a clock that is even is a part of the waveform
        near = "'time', 'p_res', 'p_act'" if group is None or ".mat" in file else "'p_res', 'p_act', 'x_d'"
        return f"{file}, {self.template.format(noun=noun, item=item, clock=clock, near=near, **places)}"


SPOILT = {
    "not a number": Spoilt(
        _with_value("x_d", 7, np.nan),
        "{x_d}, {item} 8: 'nan' is not a finite number; remove the {item} or repair it",
    ),
    "infinity": Spoilt(
        _with_value("p_act", 0, -np.inf),
        "{p_act}, {item} 1: '-inf' is not a finite number; remove the {item} or repair it",
    ),
    "a gap": Spoilt(
        _with_time(COUNT - 1, 0.049),
        "{time}, {item} 41: time has a gap of 0.01 where the median step is 0.001; split the trace there, or record it "
        "without loss",
    ),
    "time runs back": Spoilt(
        _with_time(4, 0.0025),
        "{time}, {item} 5: time must increase from {item} to {item}, but it runs back (0.003 to 0.0025); remove the "
        "repeated or misplaced {item}s",
    ),
    "time stands still": Spoilt(
        _with_time(4, 0.003),
        "{time}, {item} 5: time must increase from {item} to {item}, but it stands still (0.003 to 0.003); remove the "
        "repeated or misplaced {item}s",
    ),
    "picoseconds that pretend to be seconds": Spoilt(
        _faster(1e12),
        "{clock}: the median step of a trace must be 1e-06 to 0.5 s, but here it is 1e+09 s; check the unit of time",
    ),
    "milliseconds that pretend to be seconds": Spoilt(
        _faster(1e3),
        "{clock}: the median step of a trace must be 1e-06 to 0.5 s, but here it is 1 s; check the unit of time",
    ),
    "a rate that no bench has": Spoilt(
        _faster(1e-9),
        "{clock}: the median step of a trace must be 1e-06 to 0.5 s, but here it is 1e-12 s; check the unit of time",
    ),
    "the input is missing": Spoilt(
        lambda signals: {name: signal for name, signal in signals.items() if name != "pwm"},
        "{noun} pwm: no {noun} is called pwm; name it in channels.pwm, the nearest names are {near}",
    ),
    "an unknown unit": Spoilt(
        _with("x_d", unit="inch"), "{x_d}: the unit 'inch' is not known here; use one of m, mm, um"
    ),
    "a pressure neither gauge nor absolute": Spoilt(
        _with("p_act", unit="mbar"),
        "{p_act}: a pressure must be gauge or absolute, but its unit is 'mbar'; write unit = 'mbar gauge' or unit = "
        "'mbar absolute' in channels.p_act",
    ),
    "no unit": Spoilt(
        _with("x_d", unit=None),
        "{x_d}: the unit is missing; write e.g. unit = 'mm' in channels.x_d",
    ),
    "a chamber above atmosphere": Spoilt(
        _with_value("p_act", 3, 51.0),
        f"{{p_act}}, {{item}} 4: 51 [mbar gauge] is outside what sensor and physics allow {RANGE}",
    ),
}
