"""Statements on crank and aerodynamic force [3.14-3.17]."""

import functools

import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.parts import PRINTED, polynomial_terms

from . import experiments
from .rows import Between, Found, Kind, Near, Row

ANGLES = np.linspace(4.0, 36.0, 65)
"""deg; from closed to open."""
RATIOS = np.array([1.5, 2.0, 2.5])
"""Pressure ratios where the printed polynomial makes most sense."""
SEVERE = 3e5
"""Pa gauge at the turbine's inlet; the largest of the thesis."""
FIRST_TRAVEL = 8.8
"""mm; "the previous" actuator of section 3.6."""
TRIAL_FORCE = 10.0
"""N; a constant vane force, to see what (3.16) makes of it."""


def polynomial(angle: np.ndarray, ratio: np.ndarray | float) -> np.ndarray:
    """Force in N of (3.15) with the printed digits, without a guard, at crank angles in degrees."""
    return np.tensordot(PRINTED, np.stack([angle * 0 + term for term in polynomial_terms(angle, ratio)]), 1)


def _travel() -> float:
    """mm."""
    return 1e3 * float(experiments.actuator().diaphragm.travel)


def _angle_of(opening: float) -> float:
    """Crank angle in degrees at an opening in mm [3.14]."""
    return float(vgtjax.Crank().angle(jnp.asarray(1e-3 * opening)))


def _vane_travel() -> Found:
    range_of = {travel: _angle_of(travel) - _angle_of(0.0) for travel in (_travel(), FIRST_TRAVEL)}
    facts = {
        "open": f"{_angle_of(_travel()):.1f}",
        "needed": f"{48 / _travel():.2f}",
        "first": f"{range_of[FIRST_TRAVEL]:.1f}",
    }
    return Found(range_of[_travel()], facts)


def _stroke_of_angles() -> Found:
    """Diaphragm travel in mm between 16 and 32 degrees."""
    crank = vgtjax.Crank()
    stroke = 1e3 * float(crank.opening(jnp.asarray(32.0)) - crank.opening(jnp.asarray(16.0)))
    return Found(stroke, {"open": f"{_angle_of(_travel()):.1f}", "first": f"{_angle_of(FIRST_TRAVEL):.1f}"})


def _where_largest() -> Found:
    """Crank angle in degrees of the largest force, for each of `RATIOS`; and the force at ratio 2."""
    force = {ratio: polynomial(ANGLES, ratio) for ratio in RATIOS}
    two = force[2.0]
    facts = {
        "closed": f"{two[0]:.1f}",
        "least": f"{two.min():.1f}",
        "at": f"{ANGLES[two.argmin()]:.0f}",
        "open": f"{two[-1]:.0f}",
    }
    return Found(tuple(float(ANGLES[values.argmax()]) for values in force.values()), facts)


def _share_rising() -> Found:
    """Percent of crank angles and ratios up to that of 3000 mbar at which force grows with the ratio."""
    ratios = np.linspace(1.0, _severe_ratio(), 60)
    force = np.stack([polynomial(ANGLES, ratio) for ratio in ratios])
    rising = np.diff(force, axis=0) > 0
    middle = (ratios[1:] > RATIOS[0]) & (ratios[1:] < RATIOS[-1])
    return Found(100 * float(rising.mean()), {"middle": f"{100 * rising[middle].mean():.0f}"})


def _severe_ratio() -> float:
    return 1 + SEVERE / experiments.STANDARD_ATMOSPHERE


def _straightness() -> Found:
    """Slope of force over crank angle at 36 deg over that at 20 deg, one for a straight line."""
    ends = [np.diff(polynomial(end + np.array([-0.1, 0.1]), ratio))[0] for ratio in RATIOS for end in (20.0, 35.9)]
    return Found(tuple(float(value) for value in np.divide(ends[1::2], ends[0::2])))


def _without_gas() -> Found:
    force = polynomial(ANGLES, 1.0)
    least, largest = float(force.min()), float(force.max())
    return Found((least, largest), {"least": f"{least:.1f}", "largest": f"{largest:.1f}"})


def _severe_force() -> Found:
    return Found(float(polynomial(np.array([4.0]), _severe_ratio())[0]), {"ratio": f"{_severe_ratio():.2f}"})


def _force_from_loops() -> Found:
    """What (3.16) makes of the loops with and without a constant vane force, in N."""
    constant = vgtjax.HysteresisMap()
    tables = dict.fromkeys(("closing", "opening"), jnp.full_like(constant.closing, TRIAL_FORCE))
    constant = vgtjax.replace_parameters(constant, tables)
    cold = experiments.loop_of(experiments.pressure_ramp(experiments.mechanical(), experiments.TOP))
    loaded = experiments.loop_of(
        experiments.pressure_ramp(experiments.mechanical(vane_force=constant), experiments.TOP, turbine=SEVERE)
    )
    area = float(experiments.actuator().diaphragm.area)
    return Found(area * float(np.mean(loaded.closing - cold.closing)), {"put_in": f"{TRIAL_FORCE:g}"})


_crank = functools.partial(Row, section="3.4 Aerodynamic force: crank")
_row = functools.partial(Row, section="3.4.1 Aerodynamic force from a force sensor")
_map = functools.partial(Row, section="3.4.2 Aerodynamic force from hysteresis")

ROWS = (
    _crank(
        id="crank-closed",
        kind=Kind.INPUT,
        quantity="crank angle with the vanes closed",
        where="(3.14), section 3.6",
        printed="4 deg",
        unit="deg",
        rule=Near(4.0, 0.05),
        ours=lambda: _angle_of(0.0),
        reason="The offset of (3.14), which our crank was given.",
    ),
    _crank(
        id="vane-travel",
        kind=Kind.RESULT,
        quantity="vane travel over the whole stroke of 10.13 mm",
        where="(3.14), section 3.6",
        printed="48 deg",
        unit="deg",
        rule=Near(48.0, 0.5),
        ours=_vane_travel,
        reason="3.12 deg/mm give {ours} deg, from 4 to {open} deg ({first} deg for a stroke of 8.8 mm); 48 deg would "
        "need {needed} deg/mm.",
    ),
    _crank(
        id="stroke-2000",
        kind=Kind.RESULT,
        quantity="diaphragm travel between 16 and 32 deg at 2000 RPM",
        where="(3.14), Figure 3.20",
        printed="4 mm",
        unit="mm",
        rule=Near(4.0, 0.5),
        ours=_stroke_of_angles,
        reason="At 3.12 deg/mm. The open end of 32 deg fits a stroke of 8.8 mm ({first} deg), not one of 10.13 mm "
        "({open} deg), which suggests that this test was made with the first actuator.",
    ),
    _row(
        id="polynomial-largest",
        kind=Kind.RESULT,
        quantity="crank angle of the largest force at ratios 1.5, 2 and 2.5",
        where="(3.15), Figures 3.8, 3.19, 3.20",
        printed="smallest angle: largest with the vanes closed",
        unit="deg",
        rule=Near(4.0, 1.0),
        ours=_where_largest,
        reason="As printed, the force at ratio 2 is {closed} N at 4 deg, falls to {least} N at {at} deg and rises to "
        "{open} N at 36 deg. No range of the fit is printed.",
    ),
    _row(
        id="polynomial-rising",
        kind=Kind.RESULT,
        quantity="where force grows with the pressure ratio, between 1 and that of 3000 mbar",
        where="section 3.4.1",
        printed="everywhere",
        unit="%",
        rule=Near(100.0, 0.5),
        ours=_share_rising,
        reason="In {ours} % of that range; between ratios 1.5 and 2.5 in {middle} %.",
    ),
    _row(
        id="polynomial-straight",
        kind=Kind.RESULT,
        quantity="slope of force over angle at 36 deg over that at 20 deg, at ratios 1.5, 2 and 2.5",
        where="section 3.4.1",
        printed="1: linear at higher angles",
        unit="",
        rule=Near(1.0, 0.2),
        ours=_straightness,
        reason="A straight line has one slope.",
    ),
    _row(
        id="polynomial-cold",
        kind=Kind.RESULT,
        quantity="least and largest force at ratio 1, without exhaust gas",
        where="(3.15), section 2.2.3",
        printed="no force in cold conditions",
        unit="N",
        rule=Near(0.0, 0.5),
        ours=_without_gas,
        reason="The printed polynomial leaves {least} to {largest} N where no gas flows.",
    ),
    _row(
        id="polynomial-severe",
        kind=Kind.RESULT,
        quantity="force with closed vanes at 3000 mbar",
        where="(3.15), section 3.4.2",
        printed="against closing, growing with pressure",
        unit="N",
        rule=Between(0.0, np.inf),
        ours=_severe_force,
        reason="At ratio {ratio} the printed polynomial is far outside the range of its fit, whatever that was.",
    ),
    _map(
        id="force-from-loops",
        kind=Kind.IDENTITY,
        quantity="a force of 10 N against closing, recovered by (3.16) from absolute pressures",
        where="(3.16)",
        printed="10 N put in",
        unit="N",
        rule=Near(10.0, 0.1),
        ours=_force_from_loops,
        reason="{put_in} N put in as a constant come out as {ours} N; with applied (differential) pressures, or with "
        "the two terms exchanged, the sign is right.",
    ),
)
