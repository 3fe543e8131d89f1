"""Statements on Table 4.2: friction over its parameters at one speed [4.1, 4.6-4.8]."""

import functools
import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from vgtjax.sensitivity import steady_force

from .rows import Found, Kind, Near, Row
from .sensitivity import src
from .sensitivity_friction import SPEED, with_values

# Table 4.2, column by column.
COULOMB_FORCE = np.linspace(1.6, 2.6, 21)
PRINTED_FORCE = np.concatenate(
    [
        [3.12437, 3.15273, 3.13912, 3.13694, 3.12016, 3.13653, 3.14267, 3.13882, 3.120923, 3.13546, 3.13146],
        [3.12983, 3.12872, 3.140013, 3.122054, 3.13342, 3.128341, 3.13901, 3.14385, 3.14237, 3.13874],
    ]
)
STATIC_FORCE = (2.6, 3.2, 3.8)
STRIBECK_VELOCITY = (0.001, 0.0001, 0.0005)
VISCOUS_DAMPING = (180.0, 160.0, 200.0)
COLUMNS = ("coulomb_force", "static_force", "stribeck_velocity", "viscous_damping")
"""Those that act on friction that slides steadily; sigma_0 and sigma_1 don't."""
WITHIN = 0.005
"""N; half of the second decimal, though the table prints five."""
NEARBY = 0.03
"""N; the spread of the printed column."""


@functools.cache
def combinations() -> tuple[Float[np.ndarray, "combinations 4"], Float[np.ndarray, " combinations"]]:
    """Every combination of the values in Table 4.2, in the order of `COLUMNS`, and the friction that it slides with."""
    every = np.array(list(itertools.product(COULOMB_FORCE, STATIC_FORCE, STRIBECK_VELOCITY, VISCOUS_DAMPING)))
    return every, steady_forces(COLUMNS, every)


def steady_forces(names: Sequence[str], values: Float[np.ndarray, "rows names"]) -> Float[np.ndarray, " rows"]:
    """Friction in N that has slid at `SPEED` for long, for rows of values of the named parameters."""
    force = jax.jit(jax.vmap(lambda row: steady_force(with_values(dict(zip(names, row, strict=True))), SPEED)))
    return np.asarray(force(jnp.asarray(values)))


def _table_range() -> Found:
    """Range of F_f in N that the column of F_c alone gives, and what gives the printed mean."""
    force = steady_forces(("coulomb_force",), COULOMB_FORCE[:, None])
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


def _model_src() -> Found:
    every, force = combinations()
    found = dict(zip(COLUMNS, src(every, force), strict=True))
    return Found(found["coulomb_force"], {name: f"{value:.2g}" for name, value in found.items()})


_row = functools.partial(Row, section="4.1.3 Friction model parameters")

ROWS = (
    _row(
        id="table-4-2-columns",
        kind=Kind.RESULT,
        quantity="SRC of the printed columns F_c and F_f",
        where="(4.1), Table 4.2",
        printed="0.3945",
        unit="",
        rule=Near(0.3945, 5e-5),
        ours=lambda: src(COULOMB_FORCE[:, None], PRINTED_FORCE)[0],
        reason="The squared correlation (4.1) of the two columns as printed is {ours}: they are as good as unrelated.",
    ),
    _row(
        id="table-4-2-range",
        kind=Kind.RESULT,
        quantity="range of F_f at 5 mm/s as F_c goes from 1.6 to 2.6 N",
        where="(4.6), (4.7), Table 4.2",
        printed="3.12016 to 3.15273 N",
        unit="N",
        rule=Near(float(np.ptp(PRINTED_FORCE)), 0.005),
        ours=_table_range,
        reason="Sliding friction is F_c + (F_s - F_c) exp(-v/v_s) + sigma_2 v and follows F_c, from {least} to {most} "
        "N with the rest as in Table B.2. The printed mean, {mean} N, is what the middle of the column gives "
        "({middle} N), as if F_f had been computed without its row's F_c: suggestive, not proved.",
    ),
    _row(
        id="table-4-2-values",
        kind=Kind.RESULT,
        quantity="rows of the table whose F_f follows from their F_c and any F_s, v_s and sigma_2 of the table",
        where="(4.6), (4.7), Table 4.2",
        printed="F_f in 21 rows",
        unit="of 21",
        rule=Near(21.0, 0.5),
        ours=_table_values,
        reason="Within 0.005 N, at 5 mm/s; the nearest is {closest} N off, the farthest {farthest} N. With the F_c of "
        "any row {any} of 21 can be met; forces as near as the column is wide need an F_c of {low} to {high} N.",
    ),
    _row(
        id="src-coulomb",
        kind=Kind.RESULT,
        quantity="SRC of F_c with every combination of the values in the table",
        where="(4.1), (4.6), (4.7), Table 4.2",
        printed="0.3945",
        unit="",
        rule=Near(0.3945, 5e-5),
        ours=_model_src,
        reason="sigma_2 has {viscous_damping}, v_s {stribeck_velocity}, F_s {static_force}; in steady sliding sigma_0 "
        "and sigma_1 have none.",
    ),
)
