"""A bench trace: signals over time, in SI units with absolute pressures."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import jax
import numpy as np
from jaxtyping import Float, Int, PyTree
from numpy.typing import ArrayLike

from .._errors import InputError
from ._channel import Channel, Samples, as_channel, gaps_of
from ._drive import Drive, Ramp, Start
from ._duty import FARTHEST_EDGE, STRAIGHT, beside, edges_of, inside, onto
from ._grid import same_clock, share_time
from ._signals import SIGNALS

STANDARD_ATMOSPHERE = 101013.0
"""Pa; what turns gauge into absolute pressure unless a trace states its own atmosphere."""
ASSUMED_RESERVOIR = 2.0e4
"""Pa absolute; assumed where no trace tells the reservoir pressure."""
SENSOR_PRESSURE_OFFSET = 5000.0
"""Pa; pressure sensors are trusted to within 50 mbar."""
START_WINDOW = 0.05
"""s; the start of a trace that does not begin at rest is the mean of its first 50 ms."""

Signal = ArrayLike | Channel | None
Hold = Literal["zero-order", "linear"]


class Trace:
    """Signals of one bench run.

    `pwm` in percent (held from its sample to the next, or linear between them, as `duty_hold` says), `p_act` and
    `p_res` in Pa absolute, `p_trb` in Pa gauge, `x_d` in m, `f_vane` and `f_drive` in N, `x_drive` in m (a position
    that drives the pneumatic model, free of the sensor's offset and noise; no file has it). Each is an array, sampled
    at `time` in s, or a [`Channel`][] with a clock of its own, or `None` where the bench did not record it.
    `atmosphere` in Pa; `notes` says what loading assumed or ignored.

    As attributes, the signals are the values of their valid samples. `channels` has them with their times, by name.
    `time` then holds the times at which the trace is simulated: the common clock, or else all samples of all channels
    in the time that they share. A trace can't be changed, see `replace`.

    **Raises:** `InputError` as [`Channel`][] does, and when the channels have fewer than two samples in common time, or
    a unit is not that of the signal, or `duty_hold` is another word.
    """

    time: Float[np.ndarray, " time"]
    channels: Mapping[str, Channel]
    pwm: Samples | None
    p_act: Samples | None
    p_res: Samples | None
    p_trb: Samples | None
    x_d: Samples | None
    f_vane: Samples | None
    f_drive: Samples | None
    x_drive: Samples | None
    atmosphere: float
    name: str
    notes: tuple[str, ...]
    start_number: int
    """Which of the start states that a fit frees is its own; zero for none."""
    duty_hold: Hold
    """How the duty is between its samples."""
    duty_late: float
    """s by which the duty is late already; a delay of the duty counts beyond that."""
    has_common_clock: bool
    """Whether every channel is sampled at `time`."""

    def __init__(
        self,
        time: ArrayLike | None = None,
        *,
        pwm: Signal = None,
        p_act: Signal = None,
        p_res: Signal = None,
        p_trb: Signal = None,
        x_d: Signal = None,
        f_vane: Signal = None,
        f_drive: Signal = None,
        x_drive: Signal = None,
        atmosphere: float = STANDARD_ATMOSPHERE,
        name: str = "trace",
        notes: tuple[str, ...] = (),
        start_number: int = 0,
        duty_hold: Hold = "zero-order",
        duty_late: float = 0.0,
    ):
        if duty_hold not in get_args(Hold):
            raise InputError(
                f"{name}: duty_hold must be one of {', '.join(get_args(Hold))}, but it is '{duty_hold}'; choose one"
            )
        given = dict(pwm=pwm, p_act=p_act, p_res=p_res, p_trb=p_trb, x_d=x_d)
        given |= dict(f_vane=f_vane, f_drive=f_drive, x_drive=x_drive)
        channels = {
            signal: as_channel(name, signal, values, time) for signal, values in given.items() if values is not None
        }
        try:
            times, channels, common = share_time(channels, time)
        except InputError as error:
            raise InputError(f"{name}: {error}", "traces") from None
        vars(self).update(
            {signal: channels[signal].value if signal in channels else None for signal in given},
            time=times,
            channels=channels,
            has_common_clock=common,
            atmosphere=atmosphere,
            name=name,
            notes=notes,
            start_number=start_number,
            duty_hold=duty_hold,
            duty_late=duty_late,
        )

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a trace can't be changed, so {name} can't be set; use trace.replace({name}=...)")

    def __repr__(self) -> str:
        channels = ", ".join(f"{name} ({len(channel.time)})" for name, channel in self.channels.items())
        return f"<Trace {self.name!r} from {self.time[0]:g} s to {self.time[-1]:g} s, samples: {channels}>"

    def replace(self, **changes: Any) -> "Trace":
        """The same trace with other arguments.

        An array is sampled at the `time` given with it, or else as the channel that it replaces, a new one at the
        trace's `time`.
        """
        clock = changes.pop("time", None)
        for signal in SIGNALS.keys() & changes.keys():
            mine = self.channels[signal].time if signal in self.channels else self.time
            if changes[signal] is not None:
                changes[signal] = as_channel(self.name, signal, changes[signal], mine if clock is None else clock)
        kept: dict[str, Any] = {"atmosphere": self.atmosphere, "name": self.name, "notes": self.notes}
        kept |= {"start_number": self.start_number, "duty_hold": self.duty_hold, "duty_late": self.duty_late}
        return Trace(self.time if clock is None else clock, **{**self.channels, **kept, **changes})

    @property
    def longest_interval(self) -> float:
        """Longest time between two samples in s."""
        return float(np.max(np.diff(self.time)))

    def window(self, begin: float, end: float) -> "Trace":
        """The part between two times in s, both included; time keeps its zero.

        **Raises:** `InputError` when fewer than two samples are left.
        """
        inside = self.time[(self.time >= begin) & (self.time <= end)]
        if len(inside) < 2:
            raise InputError(
                f"{self.name}: the window [{begin:g}, {end:g}] s must keep at least two samples of a trace that "
                f"runs from {self.time[0]:g} to {self.time[-1]:g} s; widen it"
            )
        cut = {name: channel.cut(inside[0], inside[-1]) for name, channel in self.channels.items()}
        return self.replace(time=inside, **cut)

    def at(self, name: str, time: Samples | None = None) -> Samples | None:
        """A signal at any times in s, by default at `time`: held or linear, as `SIGNALS` and `duty_hold` say; `None`
        without it."""
        channel = self.channels.get(name)
        if channel is None:
            return None
        time = self.time if time is None else time
        if same_clock(channel.time, time):
            return channel.value
        held = SIGNALS[name].held and self.duty_hold == "zero-order"
        return channel.hold(time) if held else channel.interpolate(time)

    def sampled(self, name: str) -> Channel | None:
        """The valid samples of a channel among `time`, at which a simulation can be compared; `None` without any."""
        channel = self.channels.get(name)
        return None if channel is None else channel.within(self.time[0], self.time[-1])

    def rows(self, name: str) -> Int[np.ndarray, " samples"]:
        """Where those samples are in `time`."""
        channel = self.sampled(name)
        return np.zeros(0, int) if channel is None else np.searchsorted(self.time, channel.time)

    def rows_at(self, time: Samples) -> Int[np.ndarray, " samples"]:
        """Where some of its times are in `time`."""
        return np.searchsorted(self.time, time)

    def on_one_clock(self, time: Samples | None = None) -> "Trace":
        """All channels at the same times, for what needs position and pressure in pairs.

        **Arguments:** `time` in s, increasing; by default the samples of that of `x_d` and `p_act` which has fewer, so
        that no sample is made up from others, as long as every channel has valid ones around. A trace with one clock
        is returned as it is. A duty that is linear between samples is held over each interval at its mean.
        """
        if time is None:
            if self.has_common_clock:
                return self.with_held_duty()
            time = self._shared_times()
        sampled = self.replace(**{name: Channel(time, np.asarray(self.at(name, time))) for name in self.channels})
        return sampled.with_held_duty()

    @property
    def has_pairs(self) -> bool:
        """Whether position and pressure are both measured, and have times in common as `on_one_clock` needs them."""
        return self.x_d is not None and self.p_act is not None and len(self._shared_times()) > 1

    def _shared_times(self) -> Samples:
        """The samples of that of `x_d` and `p_act` which has fewer, within those of every linear channel."""
        measured = [channel for name in ("x_d", "p_act") if (channel := self.sampled(name)) is not None]
        time = min((channel.time for channel in measured), key=len, default=self.time)
        linear = [channel.time for name, channel in self.channels.items() if not SIGNALS[name].held]
        return time[(time >= max(t[0] for t in linear)) & (time <= min(t[-1] for t in linear))]

    def with_ramped_duty(self) -> "Trace":
        """The same trace with a duty that is linear between its samples."""
        return self.replace(duty_hold="linear")

    def with_held_duty(self) -> "Trace":
        """The same trace with a duty that is held over every interval of `time`: at its mean where it was linear."""
        duty = self.at("pwm")
        if self.duty_hold == "zero-order" or duty is None:
            return self
        means = np.append(0.5 * (duty[1:] + duty[:-1]), duty[-1])
        return self.replace(pwm=Channel(self.time, means), duty_hold="zero-order")

    def with_late_duty(self, delay: float) -> "Trace":
        """The same trace with the duty that reaches a valve `delay` s later than it says (earlier, if negative).

        Every jump, and every change of its rate, is then at a time of the trace, which has more of them where it falls
        between two.
        """
        duty = self.channels["pwm"]
        knots = self._knots()
        moved = duty.time[knots] + delay
        if self.duty_hold == "zero-order":
            return self._jumping(knots, onto(self._while_held(moved), self.time))
        there = moved[(moved > self.time[0]) & (moved < self.time[-1])]
        time = np.union1d(self.time, onto(there, self.time))
        return self.replace(pwm=Channel(time, duty.interpolate(time - delay)))

    def _while_held(self, times: Samples) -> Samples:
        """Times of jumps, none before the duty's first sample or behind the end, to which the last one is held."""
        duty = self.channels["pwm"]
        return inside(times, np.array([duty.time[0], max(duty.time[-1], self.time[-1])]))

    def _knots(self) -> Int[np.ndarray, " knots"]:
        """Samples of the duty's own clock at which it jumps, or its rate changes where it is linear between them."""
        duty = self.channels["pwm"]
        if self.duty_hold == "zero-order":
            return np.flatnonzero(np.diff(duty.value)) + 1
        rates = np.concatenate([[0.0], np.diff(duty.value) / np.diff(duty.time), [0.0]])
        return np.flatnonzero(np.abs(np.diff(rates)) > STRAIGHT)

    def edges(self) -> Int[np.ndarray, " edges"]:
        """Samples of the duty's own clock at which it jumps between levels that it holds for five samples and more."""
        jumps = "pwm" in self.channels and self.duty_hold == "zero-order"
        return edges_of(self.channels["pwm"].value) if jumps else np.zeros(0, int)

    def with_late_edges(self, late: Sequence[float], delay: float = 0.0) -> "Trace":
        """The same trace with each of the duty's `edges` so many seconds later (earlier, if negative), at a time of its
        own: the trace has one time more for each.

        An edge is moved by twice the usual interval of the duty at most, so that none passes another one.

        **Arguments:** `delay` in s of all edges, beside that; only of a duty without other jumps, which have no times
        of their own.
        """
        duty, edges = self.channels["pwm"], self.edges()
        jumps = self._knots()
        delay = delay if len(jumps) == len(edges) else 0.0
        farthest = FARTHEST_EDGE * float(np.median(np.diff(duty.time)))
        began = duty.time[edges] + np.clip(late, -farthest, farthest) + delay
        return self._jumping(edges, beside(self._while_held(began), self.time), duty_late=delay)

    def _jumping(self, samples: Int[np.ndarray, " moved"], moved: Samples, **changes: float) -> "Trace":
        """The same trace with the jumps of its duty at some samples at other times in s, each a time of the trace, and
        with other arguments."""
        duty = self.channels["pwm"]
        time = np.union1d(self.time, moved)
        jumps = np.flatnonzero(np.diff(duty.value)) + 1
        times = np.append(duty.time[0], duty.time[jumps])
        times[1 + np.searchsorted(jumps, samples)] = moved
        held = Channel(times, duty.value[np.append(0, jumps)]).hold(time)
        return self.replace(pwm=Channel(time, held), **changes)

    def drive(self) -> Drive:
        """Inputs over the interval that each time begins; the last one has no length."""
        duration = np.append(np.diff(self.time), 0.0)

        def ramp(name: str) -> Ramp | None:
            values = self.at(name)
            return None if values is None else Ramp(values, np.append(np.diff(values) / duration[:-1], 0.0))

        def constant(value: float) -> Ramp:
            return Ramp(np.full_like(self.time, value), np.zeros_like(self.time))

        duty = ramp("pwm")
        held = self.duty_hold == "zero-order"
        return Drive(
            duration=duration,
            ambient_shift=np.full_like(self.time, self.atmosphere - STANDARD_ATMOSPHERE),
            turbine=ramp("p_trb") or constant(0.0),
            pwm=None if duty is None else duty.start,
            pwm_rate=None if duty is None else np.zeros_like(duty.rate) if held else duty.rate,
            reservoir=ramp("p_res") or constant(ASSUMED_RESERVOIR),
            chamber=ramp("p_act"),
            force=ramp("f_drive"),
            position=ramp("x_drive"),
        )

    def jumps(self) -> Int[np.ndarray, " jumps"]:
        """Samples of `time` at which the duty differs from the one before, held: there the vector field jumps."""
        return np.zeros(0, int) if self.duty_hold == "linear" else self._changes()

    def _changes(self) -> Int[np.ndarray, " changes"]:
        """Samples of `time` from which the duty is another, or no longer constant."""
        duty = self.at("pwm")
        later = 1 if self.duty_hold == "zero-order" else 0
        return np.zeros(0, int) if duty is None else np.flatnonzero(np.diff(duty)) + later

    def start(self) -> Start:
        """What the trace says about the state at its first sample."""
        changes, duty = self._changes(), self.at("pwm")
        pressure, position = self._beginning("p_act"), self._beginning("x_d")
        # What the first duty step has moved already says nothing about the rest before it.
        before = self._beginning("p_act", self.time[max(changes[0], 1)]) if len(changes) else pressure
        vented = before is None or abs(before - self.atmosphere) <= SENSOR_PRESSURE_OFFSET
        off = duty is None or duty[0] == 0.0
        return Start(
            at_rest=np.asarray(off and vented and self.f_drive is None and not self.start_number),
            pressure=np.asarray(0.0 if pressure is None else pressure),
            pressure_known=np.asarray(pressure is not None),
            position=np.asarray(0.0 if position is None else position),
            position_known=np.asarray(position is not None),
            number=np.asarray(self.start_number),
        )

    def _beginning(self, name: str, end: float = np.inf) -> float | None:
        """Mean of a channel's own first `START_WINDOW`, before `end` in s, where it has samples there."""
        channel = self.sampled(name)
        if channel is None:
            return None
        first = (channel.time <= channel.time[0] + START_WINDOW) & (channel.time < end)
        return float(np.mean(channel.value[first])) if np.any(first) else None


def require(trace: Trace, needs: tuple[str, ...]) -> None:
    """Checks that a trace has the columns that a model needs, from its first to its last time.

    **Raises:** `InputError` naming the missing column, or where it has no valid samples.
    """
    for need in needs:
        alternatives = need.split("|")
        present = [column for column in alternatives if column in trace.channels]
        if not present:
            raise InputError(
                f"{trace.name}: this model needs the column {' or '.join(alternatives)}, which is missing; "
                "record it or choose another model",
                "traces",
            )
        for column in present:
            time = trace.channels[column].time
            # A position serves for the start of a rod; what drives a model has to be there throughout.
            if (
                column != "x_d"
                and not SIGNALS[column].held
                and not (time[0] <= trace.time[0] and trace.time[-1] <= time[-1])
            ):
                raise InputError(
                    f"{trace.name}: what drives this model must be valid from {trace.time[0]:g} to "
                    f"{trace.time[-1]:g} s, but {column} is so from {time[0]:g} to {time[-1]:g} s; cut the trace with "
                    "a window",
                    "traces",
                )
            gaps = gaps_of(time)
            if column == "p_act" and len(gaps):  # of inputs none is read
                raise InputError(
                    f"{trace.name}: what drives this model must be valid throughout, but p_act is not from "
                    f"{time[gaps[0] - 1]:g} to {time[gaps[0]]:g} s; cut the trace with a window",
                    "traces",
                )


def cast(tree: PyTree[np.ndarray], dtype: np.dtype) -> PyTree[np.ndarray]:
    """Floating leaves of a drive or start in the precision of a model; flags and numbers stay what they are."""
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if leaf.dtype.kind == "f" else leaf, tree)
