"""Steady flow through nozzles of random sizes, at random angles, pressures and speeds: whether it is found."""

from typing import Any, NamedTuple

import jax
import numpy as np

from vgtjax import InputError
from vgtjax.parts import Stage
from vgtjax.turbine import Gas, Nozzle, PassageFlow, States, first_guess, steady_near

from ..table import Section

NOZZLES, SEED, CELLS = 550, 1, 112
SPREAD, SPREADS = 0.25, {"outlet_angle": 0.05, "vanes.zeta": 1.0, "rotor.zeta": 1.0, "loading_length": float(np.log(2))}
"""Of the logarithm of every size to either side, and of those that may be less or are known worse."""
DEGREES, HIGHEST, FASTEST = (4.0, 54.0), 4.5e5, 2.0
"""Of the vanes; Pa absolute before them; times the design speed of the wheel."""
FOLLOWED = np.append(np.linspace(0.5, 0.9, 5), np.linspace(0.905, 1.0, 20))
"""Shares of the speed over which a flow that was not found is followed."""
COLUMNS = ("nozzle", "vanes", "before them", "wheel, times design", "followed up to", "mass flow there", "power there")


class Case(NamedTuple):
    """A nozzle, the angle of its vanes in rad, the total pressure in Pa absolute and the wheel's speed in rad/s."""

    nozzle: Nozzle
    vane_angle: float
    total_pressure: float
    speed: float


def measure() -> Section:
    """Looks for the flows, and follows those that are not found from half of the wheel's speed."""
    section = Section("Steady flow through random nozzles", _ABOUT, COLUMNS, notes=list(_NOTES))
    rng = np.random.default_rng(SEED)
    missed = 0
    for number in range(NOZZLES):
        case = _draw(rng)
        flow, _ = _solve(*case, None)
        if not bool(flow.converged):
            missed += 1
            section.add(str(number), *_followed(case))
    section.notes.insert(0, f"{NOZZLES - missed} of {NOZZLES} are found.")
    return section


def _draw(rng: np.random.Generator) -> Case:
    """A nozzle that lets gas through; others are drawn again."""
    default, shape = jax.tree.flatten(Nozzle())
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(Nozzle())]
    spread = np.array([next((each for end, each in SPREADS.items() if name.endswith(end)), SPREAD) for name in names])
    while True:
        factors = np.exp(rng.uniform(-spread, spread))
        vane_angle = np.radians(rng.uniform(*DEGREES))
        try:
            nozzle = jax.tree.unflatten(shape, [leaf * factor for leaf, factor in zip(default, factors, strict=True)])
            nozzle.require_working()
            nozzle.require_range(vane_angle)
        except InputError:
            continue
        stage = Stage(nozzle=nozzle)
        pressure = rng.uniform(1.01 * float(stage.outlet_pressure), HIGHEST)
        return Case(nozzle, vane_angle, pressure, rng.uniform(0, FASTEST) * float(stage.speed_at(pressure)))


@jax.jit
def _solve(
    nozzle: Nozzle, vane_angle: Any, total_pressure: Any, speed: Any, near: States | None
) -> tuple[PassageFlow, States]:
    stage = Stage()
    passage = nozzle.passage(vane_angle, speed, CELLS, stage.gas)
    return steady_near(
        passage, nozzle.inlet(total_pressure, stage.total_temperature), stage.outlet_pressure, stage.gas, near
    )


def _followed(case: Case) -> tuple[str, ...]:
    """From a slower wheel to as fast a one as a flow is found with, in words."""
    inlet = case.nozzle.inlet(case.total_pressure, Stage().total_temperature)
    near = first_guess(case.nozzle.passage(case.vane_angle, 0.5 * case.speed, CELLS), inlet, Gas())
    last, there = 0.0, None
    for share in FOLLOWED:
        flow, states = _solve(*case[:3], share * case.speed, near)
        if not bool(flow.converged):
            break
        near, last, there = states, share, flow
    design = float(Stage(nozzle=case.nozzle).speed_at(case.total_pressure))
    told = ("", "") if there is None else (f"{1e3 * float(there.mass_flow):.2f} g/s", f"{float(there.power):.1f} W")
    return (
        f"{np.degrees(case.vane_angle):.1f} deg",
        f"{case.total_pressure / 1e5:.3f} bar",
        f"{case.speed / design:.2f}",
        f"{last:.3f} of that",
        *told,
    )


_ABOUT = (
    f"{NOZZLES} nozzles whose sizes are the default ones within a quarter, losses within a factor of 2.7 and loading "
    f"lengths of 2, vanes at {DEGREES[0]:g} to {DEGREES[1]:g} deg, up to {HIGHEST / 1e5:g} bar before them and "
    f"{FASTEST:g} times the design speed of the wheel, {CELLS} cells."
)
_NOTES = (
    "Those that are not found are listed, and followed from half of the speed of their wheel: one that is followed to "
    "all of it has a state that was lost. Where the wheel drives the gas (a negative power) and mass flow falls ever "
    "faster with speed, the state ends in a fold: none is beyond it.",
)
