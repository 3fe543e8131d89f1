"""Statements on friction [2.35, 3.1-3.12]."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import vgtjax
from vgtjax.parts import Bristle, Contact, Vanes

from . import experiments
from .rows import Between, Found, Kind, Near, Row

REVERSALS = (0.0, 25.0, 21.5, 27.0, 19.0)
"""kPa of applied pressure, one corner after the other."""


def contact(velocity: jax.Array | float) -> Contact:
    """A rod without exhaust gas that moves at a velocity in m/s."""
    zero = jnp.zeros(())
    return Contact(jnp.asarray(velocity), experiments.actuator().diaphragm.mass, Vanes(zero, zero))


def sliding_force(member: vgtjax.AbstractFriction, velocity: np.ndarray) -> np.ndarray:
    """Force in N of a friction model that has slid at a velocity in m/s for long."""

    def at(speed: jax.Array) -> jax.Array:
        touching, state = contact(speed), member.initial_state()
        if state is not None:
            # A bristle obeys z' = v - rate z.
            state = Bristle(speed / member.relaxation(touching, state).deflection)
        return member(touching, state, 100.0 * jnp.sign(speed))[0]

    return np.asarray(jax.vmap(at)(jnp.asarray(velocity)))


def loop(member: vgtjax.Dahl | vgtjax.LuGre) -> tuple[np.ndarray, np.ndarray]:
    """Position in m and friction without its viscous part in N, along a ramp of pressure with reversals."""
    dry = vgtjax.replace_parameters(member, {"viscous_damping": 0.0})
    run = experiments.pressure_path(experiments.mechanical(member), [1e3 * kilopascal for kilopascal in REVERSALS])
    force = jax.vmap(lambda v, z: dry(contact(v), Bristle(z), jnp.zeros(()))[0])(run.v_d, run.z)
    moving = np.asarray(run.x_d) > 0.1e-3
    return np.asarray(run.x_d)[moving], np.asarray(force)[moving]


def _held() -> float:
    """Friction in N on a rod at rest under -5 N, as a size."""
    friction = vgtjax.Karnopp()
    force, _ = friction(contact(0.0), None, jnp.asarray(-5.0))
    return abs(float(force))


def _stribeck() -> Found:
    """Least and largest `g(v)` in N up to 0.1 m/s [3.7]."""
    speeds = jnp.linspace(0.0, 0.1, 1001)
    values = jax.vmap(vgtjax.LuGre().stribeck)(speeds)
    return Found((float(values.min()), float(values.max())))


def _viscous() -> Found:
    """Slope of the steady force on the rod over velocity, far above the Stribeck velocity, in N s/m."""
    friction, body = vgtjax.LuGre(), experiments.actuator().diaphragm
    slope = friction.viscous_damping + body.damping
    zeta = slope / (2 * jnp.sqrt(body.stiffness * body.mass))
    return Found(float(slope), {"twice": f"{2 * float(friction.viscous_damping):g}", "zeta": f"{float(zeta):.3f}"})


def _cold_width() -> Found:
    """Mean width of the cold loop in mbar, and what it would be of Coulomb friction, of stiction, and of none."""
    friction, area = vgtjax.LuGre(), float(experiments.actuator().diaphragm.area)
    free = vgtjax.LuGre(static_force=0.0, coulomb_force=0.0, viscous_damping=0.0, bristle_damping=0.0)

    def width(model: vgtjax.MechanicalActuator) -> float:
        return experiments.loop_of(experiments.pressure_ramp(model, experiments.TOP)).mean_width / experiments.MBAR

    def of(force: float) -> float:
        return 2 * force / area / experiments.MBAR

    facts = {
        "coulomb": f"{of(float(friction.coulomb_force)):.1f}",
        "static": f"{of(float(friction.static_force)):.1f}",
        "none": f"{abs(width(experiments.mechanical(free))):.1f}",
    }
    return Found(width(experiments.mechanical()), facts)


def _dahl_curve() -> tuple[np.ndarray, np.ndarray]:
    return loop(vgtjax.Dahl())


def _plateau() -> float:
    """Friction in N where its curve over position is level [3.3.2.2]."""
    return float(np.max(_dahl_curve()[1]))


def _slope_at_zero() -> float:
    """Slope in N/m of friction over position where it passes zero after a turn [3.3.2.2]."""
    position, force = _dahl_curve()
    after = np.flatnonzero(np.diff(np.sign(force)))
    # Position as a cubic of friction around zero; its slope there is one over the stiffness.
    compliance = [np.polyfit(force[k - 2 : k + 4], position[k - 2 : k + 4], 3)[2] for k in after]
    return float(1 / np.mean(compliance))


def _least_friction() -> float:
    """Least size of LuGre friction along a path with reversals in N; zero where it changes sign."""
    force = loop(vgtjax.LuGre())[1]
    return 0.0 if np.any(np.diff(np.sign(force))) else float(np.abs(force).min())


_row = functools.partial(Row, section="3.3 Friction modeling")

ROWS = (
    _row(
        id="karnopp-held",
        kind=Kind.IDENTITY,
        quantity="friction that holds a rod at rest under -5 N",
        where="(3.1)",
        printed="F_p, as F_p < F_s: 5 N",
        unit="N",
        rule=Near(5.0, 0.05),
        ours=_held,
        reason="(3.1) compares F_p with F_s where |F_p| is meant; friction at rest ends at F_s = {ours} N.",
    ),
    _row(
        id="stribeck-range",
        kind=Kind.IDENTITY,
        quantity="least and largest g(v)",
        where="(3.7), Figure 3.5",
        printed="F_c <= g <= F_s",
        unit="N",
        rule=Between(2.8, 3.2),
        ours=_stribeck,
        reason="From F_s at rest to F_c beyond a few Stribeck velocities, by (3.7) whatever its parameters.",
    ),
    _row(
        id="viscous",
        kind=Kind.INPUT,
        quantity="viscous damping that acts on the rod",
        where="Table B.2, (3.13)",
        printed="206 N s/m, as b_d and as sigma_2",
        unit="N s/m",
        rule=Near(206.0, 0.5),
        ours=_viscous,
        reason="Table B.2 gives one value for both, (3.13) applies both, {twice} N s/m in sum. We take it once, as "
        "sigma_2, and read it back; the damping ratio is then {zeta}.",
    ),
    _row(
        id="cold-loop",
        kind=Kind.IDENTITY,
        quantity="mean width of the loop without exhaust gas",
        where="section 3.2.1, Figure 3.2",
        printed="caused by friction's change of sign",
        unit="mbar",
        rule=Between(19.0, 22.5),
        ours=_cold_width,
        reason="2 F_c/A_d is {coulomb} mbar, 2 F_s/A_d {static} mbar, and by force balance a slow ramp lies between "
        "them; without friction the width is {none} mbar. The loop of Figure 3.2 is a picture only.",
    ),
    Row(
        section="3.3.2.2 Dahl model identification",
        id="dahl-slope",
        kind=Kind.RECOVERY,
        quantity="slope of friction over position where friction is zero",
        where="Figure 3.4",
        printed="sigma = 42150",
        unit="N/m",
        rule=Near(42150.0, 420.0),
        ours=_slope_at_zero,
        reason="Read off the curve of Dahl friction that we simulated with it, as the thesis reads it off a figure.",
    ),
    Row(
        section="3.3.2.2 Dahl model identification",
        id="dahl-plateau",
        kind=Kind.RECOVERY,
        quantity="friction where its curve over position is level",
        where="Figure 3.4",
        printed="F_c = 2.8 N",
        unit="N",
        rule=Near(2.8, 0.05),
        ours=_plateau,
        reason="Read off the same curve.",
    ),
    Row(
        section="3.4.2.1 Adaptive LuGre model",
        id="theta-finite",
        kind=Kind.IDENTITY,
        quantity="least friction on a path with reversals, by which theta divides",
        where="(3.19), (3.20)",
        printed="theta = 1 + F_aero/F_f",
        unit="N",
        rule=Between(0.01, np.inf),
        ours=_least_friction,
        reason="Friction passes through zero at every reversal, where theta has no bound. We refer the load to F_c "
        "instead.",
    ),
)
