"""The slow loop: the duty rises and falls so slowly that position over pressure is the hysteresis (section 4.2)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .._types import Scalar, Values
from ..parts import OPERATING_POINTS
from ..traces import Trace
from ._base import LONGEST, AbstractExperiment, Output, Readings, first_reach
from ._loops import LIFT, POSITIONS, PRESSED

INTERVAL = 0.01
"""s between samples; a rod that crosses 10 mm in 10 s moves 10 um in it."""
SHOWN = (3e-3, 5e-3, 7e-3)
"""m; the three positions at which open- and closed-vane effects are stated (Figs. 4.8, 4.9)."""

EFFECTS = ("saturation_shift", "open_vane_effect", "closed_vane_effect")
"""What the names of differences to the lowest turbine pressure begin with."""


class SlowLoop(AbstractExperiment):
    """Duty from zero up to `duty` percent and back within `seconds`, at each turbine pressure in Pa gauge.

    The widths, the effects and the pressures at which the vanes begin and end to move are those of section 4.2; the
    same quantities are read off recorded loops by [`measure_loops`][]. Pressures are gauge.
    """

    turbine_pressures: tuple[float, ...] = eqx.field(static=True, default=OPERATING_POINTS)
    seconds: float = eqx.field(static=True, default=30.0)
    duty: float = eqx.field(static=True, default=100.0)

    def __check_init__(self) -> None:
        named = [round(pressure / 100) for pressure in self.turbine_pressures]
        if not named or named != sorted(set(named)):
            raise InputError(
                "turbine pressures must be one or more and rise by millibars, but they are "
                f"{list(self.turbine_pressures)} Pa; sort them"
            )
        if not 2 <= self.seconds <= LONGEST or not 0 < self.duty <= 100:
            raise InputError(
                f"a slow loop needs 2 s to an hour and a duty above 0 up to 100 %, but they are {self.seconds:g} s and "
                f"{self.duty:g} %; correct them"
            )

    @property
    def traces(self) -> tuple[Trace, ...]:
        """A triangle of duty for every turbine pressure."""
        half = round(self.seconds / INTERVAL / 2)
        time = np.arange(2 * half + 1) * INTERVAL
        pwm = self.duty * (1 - np.abs(np.arange(-half, half + 1)) / half)
        return tuple(
            Trace(time, pwm=pwm, p_trb=np.full_like(time, pressure), name=f"loop_{label(pressure)}")
            for pressure in self.turbine_pressures
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        """For every pressure: numbers and the two branches; for every one above the lowest: what the gas changes."""
        found, places = list[Output](), tuple(POSITIONS.tolist())
        for pressure in self.turbine_pressures:
            at = label(pressure)
            found += [
                Output(f"hysteresis_{at}", "Pa", f"mean loop width from 2 to 8 mm at {at}"),
                Output(f"start_pressure_{at}", "Pa", f"chamber pressure at which the vanes begin to close at {at}"),
                Output(f"end_pressure_{at}", "Pa", f"chamber pressure at which the vanes are closed at {at}"),
                Output(f"loop_width_{at}", "Pa", f"loop width over position at {at}", places, "m"),
                Output(f"closing_pressure_{at}", "Pa", f"chamber pressure while closing at {at}", places, "m"),
                Output(f"opening_pressure_{at}", "Pa", f"chamber pressure while opening at {at}", places, "m"),
            ]
        for pressure in self.turbine_pressures[1:]:
            at = label(pressure)
            found.append(Output(f"saturation_shift_{at}", "Pa", f"change of the closing pressure's end by {at}"))
            for direction, word in (("open", "opening"), ("closed", "closing")):
                found += [
                    Output(
                        f"{direction}_vane_effect_{at}_{position * 1e3:g}mm",
                        "Pa",
                        f"change of the {word} pressure at {position * 1e3:g} mm by {at}",
                    )
                    for position in SHOWN
                ]
        return tuple(found)

    def read(self, x_d: Float[Array, "runs time"], p_act: Float[Array, "runs time"], ambient: Scalar) -> Readings:
        """See the base class."""
        gauge = p_act - ambient
        closing, opening = jax.vmap(_branches)(x_d, gauge)
        start, end = jax.vmap(_ends)(x_d, gauge)
        return loop_readings([label(pressure) for pressure in self.turbine_pressures], closing, opening, start, end)


def loop_readings(labels: list[str], closing: Values, opening: Values, start: Values, end: Values) -> Readings:
    """Readings of loops at several turbine pressures, the lowest first.

    **Arguments:** names of the pressures; gauge pressure in Pa of both branches at `POSITIONS`, `(runs, positions)`,
    and where the vanes begin and end to move, `(runs,)`.
    """
    found: Readings = {}
    for run, at in enumerate(labels):
        width = opening[run] - closing[run]
        found |= {
            f"hysteresis_{at}": width.mean(),
            f"start_pressure_{at}": start[run],
            f"end_pressure_{at}": end[run],
            f"loop_width_{at}": width,
            f"closing_pressure_{at}": closing[run],
            f"opening_pressure_{at}": opening[run],
        }
    for run, at in enumerate(labels[1:], 1):
        found[f"saturation_shift_{at}"] = end[run] - end[0]
        for direction, branch in (("open", opening), ("closed", closing)):
            for position in SHOWN:
                where = int(np.argmin(np.abs(POSITIONS - position)))
                found[f"{direction}_vane_effect_{at}_{position * 1e3:g}mm"] = branch[run, where] - branch[0, where]
    return found


def label(pressure: float) -> str:
    """A turbine pressure in Pa gauge as it appears in names."""
    return f"{pressure / 100:.0f}mbar"


def _branches(x_d: Float[Array, " time"], p_act: Float[Array, " time"]) -> tuple[Array, Array]:
    """Pressure on the way out and on the way back, at `POSITIONS`."""
    levels = jnp.asarray(POSITIONS, x_d.dtype)
    return first_reach(x_d, p_act, levels), first_reach(x_d[::-1], p_act[::-1], levels)


def _ends(x_d: Float[Array, " time"], p_act: Float[Array, " time"]) -> tuple[Array, Array]:
    """Pressure where the rod has left its rest by `LIFT`, and where it is that far from the stop if it gets there."""
    before, end = (first_reach(x_d, p_act, jnp.max(x_d) - distance) for distance in (2 * LIFT, LIFT))
    stopped = jnp.min(p_act) < end - PRESSED * (before - end)
    return first_reach(x_d, p_act, x_d[0] + LIFT), jnp.where(stopped, end, jnp.nan)
