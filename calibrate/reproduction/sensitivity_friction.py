"""Statements on the sensitivity of LuGre friction [4.6-4.8, Table 4.2, Figure 4.4]."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import vgtjax
from vgtjax.sensitivity.sliding import force_along, parameter_slopes, steady_force

from .rows import Between, Found, Near, Rising, Row
from .sensitivity import squared_correlation

SPEED = 0.005
"""m/s, of section 4.1.3."""
# Table 4.2, column by column.
COULOMB_FORCE = np.linspace(1.6, 2.6, 21)
PRINTED_FORCE = np.array(
    [3.12437, 3.15273, 3.13912, 3.13694, 3.12016, 3.13653, 3.14267, 3.13882, 3.120923, 3.13546, 3.13146]
    + [3.12983, 3.12872, 3.140013, 3.122054, 3.13342, 3.128341, 3.13901, 3.14385, 3.14237, 3.13874]
)
STATIC_FORCE = (2.6, 3.2, 3.8)
STRIBECK_VELOCITY = (0.001, 0.0001, 0.0005)
VISCOUS_DAMPING = (180.0, 160.0, 200.0)
COLUMNS = ("coulomb_force", "static_force", "stribeck_velocity", "viscous_damping")
"""Those that act on friction that slides steadily; sigma_0 and sigma_1 don't."""

PERCENT = {
    "bristle_stiffness": 50.0,
    "bristle_damping": 68.0,
    "viscous_damping": 90.0,
    "coulomb_force": 15.36,
    "static_force": 16.0,
    "stribeck_velocity": 50.0,
}
"""Variations that section 4.1.3 names with Figure 4.4; it names none for v_s, whose 50 % is ours."""
PERIOD = 10.0
"""s of a slow to and fro; friction at rest is then passed gently, and the rod goes far beyond the bristles' 0.07 mm."""
SAMPLES = 4000
"""A period. Against twice as many, forces along the path change by less than 1e-3 N."""
AMPLITUDES = (0.001, 0.002, 0.005, 0.01)
"""m/s; Figure 4.4 has no velocity in the text."""
VISIBLE = 0.01
"""Part of the force at `SPEED` below which a line in a figure does not show that a parameter has doubled."""


def with_values(values: dict[str, Array]) -> vgtjax.LuGre:
    """The printed friction with other values; legal while traced, passive or not."""
    return vgtjax.replace_parameters(vgtjax.LuGre(), values)


@functools.cache
def combinations() -> tuple[Float[np.ndarray, "combinations 4"], Float[np.ndarray, " combinations"]]:
    """Every combination of the values in Table 4.2, in the order of `COLUMNS`, and the friction that it slides with."""
    every = np.array(list(itertools.product(COULOMB_FORCE, STATIC_FORCE, STRIBECK_VELOCITY, VISCOUS_DAMPING)))
    force = jax.vmap(lambda row: steady_force(with_values(dict(zip(COLUMNS, row, strict=True))), SPEED))
    return every, np.asarray(force(jnp.asarray(every)))


def doubling(speed: Float[np.ndarray, "*speeds"]) -> dict[str, Float[np.ndarray, "*speeds"]]:
    """Change of steady friction in N by each parameter, to first order, were it doubled: slope times value."""
    friction = vgtjax.LuGre()
    slopes = parameter_slopes(lambda member: steady_force(member, jnp.asarray(speed)), friction)
    return {name: np.asarray(slope * getattr(friction, name)) for name, slope in slopes.items()}


def shares(speed: Float[np.ndarray, "*speeds"]) -> dict[str, Float[np.ndarray, "*speeds"]]:
    """Share of each parameter in the variance of steady friction when all vary by the same small part."""
    squares = {name: change**2 for name, change in doubling(speed).items()}
    whole = sum(squares.values())
    return {name: square / whole for name, square in squares.items()}


def static_leads_below() -> float:
    """Speed in m/s below which F_s has the largest share."""
    speed = np.linspace(1e-5, 5e-3, 500)
    found = shares(speed)
    first = found.pop("static_force") > np.max(list(found.values()), axis=0)
    return float(speed[np.argmin(first)])


def cycle(amplitude: float) -> tuple[Float[np.ndarray, " time"], Float[np.ndarray, " time"]]:
    """Time in s and velocity in m/s of two periods to and fro; the second one repeats itself."""
    time = np.linspace(0.0, 2 * PERIOD, 2 * SAMPLES + 1)
    return time, amplitude * np.sin(2 * np.pi * time / PERIOD)


@functools.cache
def varied(amplitude: float) -> dict[str, Float[np.ndarray, "3 time"]]:
    """Friction in N along the second period with each parameter as printed, lowered and raised by its `PERCENT`."""
    time, velocity = cycle(amplitude)
    printed = {name: float(getattr(vgtjax.LuGre(), name)) for name in PERCENT}
    rows = [
        printed | {name: value * (1 + sign * PERCENT[name] / 100)}
        for name, value in printed.items()
        for sign in (0, -1, 1)
    ]
    batch = {name: jnp.asarray([row[name] for row in rows]) for name in PERCENT}
    force = jax.jit(jax.vmap(lambda values: force_along(with_values(values), jnp.asarray(time), jnp.asarray(velocity))))
    second = np.asarray(force(batch))[:, SAMPLES:].reshape(len(PERCENT), 3, -1)
    return dict(zip(PERCENT, second, strict=True))


def changes(amplitude: float) -> dict[str, tuple[float, float]]:
    """Root mean square change of friction in N along a period by each parameter, lowered and raised."""
    return {
        name: tuple(float(np.sqrt(np.mean((force - forces[0]) ** 2))) for force in forces[1:])
        for name, forces in varied(amplitude).items()
    }


def _table_range() -> Found:
    """Range of F_f in N that the column of F_c alone gives, and what gives the printed mean."""
    force = np.asarray(
        jax.vmap(lambda value: steady_force(with_values({"coulomb_force": value}), SPEED))(jnp.asarray(COULOMB_FORCE))
    )
    facts = {
        "mean": f"{PRINTED_FORCE.mean():.3f}",
        "least": f"{force.min():.2f}",
        "most": f"{force.max():.2f}",
        "middle": f"{force[len(force) // 2]:.3f}",
    }
    return Found(float(np.ptp(force)), facts)


def _table_values() -> Found:
    """How many printed F_f some combination with the F_c of their row gives within `WITHIN`."""
    every, force = combinations()
    distance = np.abs(PRINTED_FORCE[:, None] - force)
    of_row = np.where(np.isclose(COULOMB_FORCE[:, None], every[:, 0]), distance, np.inf).min(axis=1)
    of_any = distance.min(axis=1)
    near = every[np.any(distance < NEARBY, axis=0), 0]
    facts = {
        "closest": f"{of_row.min():.3f}",
        "farthest": f"{of_row.max():.2f}",
        "any": f"{np.sum(of_any <= WITHIN)}",
        "low": f"{near.min():.2f}",
        "high": f"{near.max():.2f}",
    }
    return Found(float(np.sum(of_row <= WITHIN)), facts)


WITHIN = 0.005
"""N; as near as half the second digit, though the table prints five."""
NEARBY = 0.03
"""N; the spread of the printed column."""


def _model_src() -> Found:
    every, force = combinations()
    others = {name: squared_correlation(column, force) for name, column in zip(COLUMNS, every.T, strict=True)}
    facts = {name: f"{value:.2g}" for name, value in others.items()}
    return Found(others["coulomb_force"], facts)


def _leading() -> Found:
    """The largest share at `SPEED` of the others, and the smaller one of F_s and F_c."""
    found = {name: float(share) for name, share in shares(np.asarray(SPEED)).items()}
    facts = {name: f"{share:.2g}" for name, share in found.items()}
    facts |= {"below": f"{1e3 * static_leads_below():.2f}", "factor": f"{np.exp(-SPEED / 1e-3):.4f}"}
    leading = [found.pop(name) for name in ("static_force", "coulomb_force")]
    return Found((max(found.values()), min(leading)), facts)


def _percent_of_force(*names: str) -> tuple[float, ...]:
    """What doubling each parameter would change at `SPEED`, in percent of the force."""
    change = doubling(np.asarray(SPEED))
    force = float(steady_force(vgtjax.LuGre(), SPEED))
    return tuple(100 * abs(float(change[name])) / force for name in names)


def _negligible_viscous() -> Found:
    """Changes by sigma_2 and by F_s at the speed of section 4.1.3."""
    found = {amplitude: changes(amplitude) for amplitude in AMPLITUDES}
    less = [a for a in AMPLITUDES if max(found[a]["viscous_damping"]) < min(found[a]["static_force"])]
    at = found[SPEED]
    steady = PERCENT["viscous_damping"] / 100 * float(doubling(np.asarray(SPEED))["viscous_damping"])
    facts = {"steady": f"{steady:.2f}", "slow": f"{1e3 * max(less, default=0.0):g}"}
    return Found((max(at["viscous_damping"]), min(at["static_force"])), facts)


def _bristles() -> Found:
    """Least change by sigma_0 over the largest by sigma_1, at each amplitude; and both at `SPEED`."""
    found = [changes(amplitude) for amplitude in AMPLITUDES]
    lowered, raised = changes(SPEED)["bristle_stiffness"]
    facts = {
        "lowered": f"{lowered:.2f}",
        "raised": f"{raised:.2f}",
        "damping": f"{max(changes(SPEED)['bristle_damping']):.2f}",
    }
    return Found(tuple(min(at["bristle_stiffness"]) / max(at["bristle_damping"]) for at in found), facts)
