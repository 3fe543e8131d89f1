"""What a user of a symbolic tool would write: the plant in CasADi, integrated by CVODES with its sensitivities.

CVODES asks for a right side with derivatives. So this one has the two smooth ends that the model itself has: the leak
of the atmosphere orifice opens over a small lift, and the flow function ends in a chord at equal pressures.
"""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

import vgtjax
from vgtjax import InputError

from .data import inputs
from .numba_plant import ENTRIES, pack
from .scipy_plant import begin, stretches


def _flow(v: dict[str, ca.SX], lift: ca.SX, reservoir: ca.SX, pressure: ca.SX, temperature: ca.SX) -> tuple:
    """Mass flow into the chamber, and the temperature of the gas that flows."""
    defaults = vgtjax.Converter(), vgtjax.Air()
    opened = ca.fmin(lift / defaults[0].opening_width, 1)
    orifice = [v[f"converter.atmosphere_orifice[{power}]"] for power in range(3)]
    up = orifice[2] * lift**2 + orifice[1] * lift + orifice[0] * opened
    saturation = v["converter.reservoir_orifice_saturation"]
    down = v["converter.reservoir_orifice_slope"] * ca.fmin(-lift, saturation)
    area = ca.if_else(lift < 0, down, up)
    source = ca.if_else(lift < 0, reservoir, v["air.pressure"])
    entering = source > pressure
    upstream = ca.fmax(source, pressure)
    ratio = ca.fmin(source, pressure) / upstream
    gamma, gas = v["air.heat_capacity_ratio"], v["air.gas_constant"]
    critical = (2 / (gamma + 1)) ** (gamma / (gamma - 1))
    linear = defaults[1].linear_above
    clipped = ca.fmin(ca.fmax(ratio, critical), linear)
    root = clipped ** (1 / gamma)
    hot = ca.if_else(entering, v["air.temperature"], temperature)
    speed = ca.sqrt(gamma / (gas * hot) * 2 / (gamma - 1) * root * (root - clipped))
    flow = area * upstream * speed * ca.fmin((1 - ratio) / (1 - linear), 1)
    return ca.if_else(entering, flow, -flow), hot


def _plunger_force(v: dict[str, ca.SX], duty: ca.SX, reservoir: ca.SX, pressure: ca.SX) -> ca.SX:
    """Force on a closed plunger at rest."""
    pull = sum(v[f"converter.magnetic_force[{power}]"] * duty**power for power in range(5))
    areas = [v[f"converter.{place}_area"] for place in ("atmosphere", "reservoir", "actuator")]
    return areas[0] * v["air.pressure"] - areas[1] * reservoir - areas[2] * pressure - pull


def _body_force(v: dict[str, ca.SX], x_d: ca.SX, v_d: ca.SX, pressure: ca.SX) -> ca.SX:
    """All forces on the rod but friction."""
    d = {name: v[f"diaphragm.{name}"] for name in ("stop_stiffness", "stop_damping", "travel")}
    open_stop = ca.fmax(-x_d, 0) * ca.fmax(1 - d["stop_damping"] * v_d, 0)
    closed_stop = ca.fmax(x_d - d["travel"], 0) * ca.fmax(1 + d["stop_damping"] * v_d, 0)
    spring = v["diaphragm.preload"] + v["diaphragm.stiffness"] * x_d + v["diaphragm.damping"] * v_d
    drive = (v["air.pressure"] - pressure) * v["diaphragm.area"]
    return drive - spring + d["stop_stiffness"] * (open_stop - closed_stop)


def _rates(v: dict[str, ca.SX], y: ca.SX, duty: ca.SX, reservoir: ca.SX) -> ca.SX:
    x_p, v_p, x_d, v_d, z, temperature, pressure = ca.vertsplit(y)
    plunger = _plunger_force(v, duty, reservoir, pressure) - v["converter.plunger_damping"] * v_p
    plunger -= v["converter.membrane_stiffness"] * x_p
    plunger -= v["converter.return_spring_stiffness"] * ca.fmax(x_p, 0)
    flow, hot = _flow(v, x_p, reservoir, pressure, temperature)
    f = {name: v[f"friction.{name}"] for name in ("static_force", "coulomb_force", "bristle_stiffness")}
    falling = ca.exp(-ca.fabs(v_d) / v["friction.stribeck_velocity"])
    stribeck = f["coulomb_force"] + (f["static_force"] - f["coulomb_force"]) * falling
    slide = v_d - f["bristle_stiffness"] * ca.fabs(v_d) * z / stribeck
    friction = f["bristle_stiffness"] * z + v["friction.bristle_damping"] * slide
    friction += v["friction.viscous_damping"] * v_d
    gamma, gas = v["air.heat_capacity_ratio"], v["air.gas_constant"]
    volume = v["chamber.volume"] - v["diaphragm.area"] * x_d
    swept = v["diaphragm.area"] * v_d
    pressure_rate = gamma * (gas * hot * flow + pressure * swept) / volume
    mass = pressure * volume / (gas * temperature)
    temperature_rate = temperature * (pressure_rate / pressure - swept / volume - flow / mass)
    body = _body_force(v, x_d, v_d, pressure) - friction
    accelerations = plunger / v["converter.plunger_mass"], body / v["diaphragm.mass"]
    return ca.vertcat(v_p, accelerations[0], v_d, accelerations[1], slide, temperature_rate, pressure_rate)


class CvodesPlant:
    """CVODES along one trace that begins at rest under a constant reservoir pressure.

    One integrator a stretch of constant duty: told to change an input on the way, CVODES goes on with the history of
    before the jump and fails. A reservoir pressure that changes at every sample would restart it there.
    """

    def __init__(self, trace: vgtjax.Trace, *, rtol: float = 1e-6, atol: float = 1e-8):
        pwm, p_res = inputs(trace)
        if np.ptp(p_res) > 0:
            raise InputError(f"{trace.name}: this plant takes one reservoir pressure; give a trace that has one")
        self._trace = trace
        y, theta, duty = ca.SX.sym("y", 7), ca.SX.sym("theta", len(ENTRIES)), ca.SX.sym("duty")
        named = dict(zip(ENTRIES, ca.vertsplit(theta), strict=True))
        rates = _rates(named, y, duty, ca.SX(p_res[0]))
        problem = {"x": y, "p": ca.vertcat(theta, duty), "ode": rates}
        options = {"reltol": rtol, "abstol": atol, "max_num_steps": 1_000_000}
        self._stretches = []
        for first, last in stretches(trace):
            times = (trace.time[first + 1 : last + 1] - trace.time[first]).tolist()
            plant = ca.integrator("plant", "cvodes", problem, 0.0, times, options)
            self._stretches.append((plant, pwm[first]))

    def simulate(self, model: vgtjax.Actuator) -> tuple[np.ndarray, np.ndarray]:
        """Position and pressure at the samples."""
        theta = pack(model)
        states = [begin(theta, self._trace).reshape(7, 1)]
        for plant, duty in self._stretches:
            states.append(np.asarray(plant(x0=states[-1][:, -1], p=[*theta, duty])["xf"]))
        found = np.concatenate(states, axis=1)
        return found[2], found[6]

    def jacobian(self, entries: Sequence[str]) -> Callable[[vgtjax.Actuator], np.ndarray]:
        """A function of the model for derivatives `(2 times, parameters)` of positions, then pressures.

        By CVODES's forward sensitivities. The start at rest is taken as given.
        """
        chosen, start = ca.MX.sym("chosen", len(entries)), ca.MX.sym("start", 7)
        theta = ca.MX.sym("theta", len(ENTRIES))
        positions = {entry: position for position, entry in enumerate(entries)}
        full = [chosen[positions[e]] if e in positions else theta[i] for i, e in enumerate(ENTRIES)]
        states = [start]
        for plant, duty in self._stretches:
            states.append(plant(x0=states[-1][:, -1], p=ca.vertcat(*full, duty))["xf"])
        found = ca.horzcat(*states)
        seen = ca.horzcat(found[2, :], found[6, :]).T
        derivatives = ca.Function("derivatives", [chosen, theta, start], [ca.jacobian(seen, chosen)])
        where = [ENTRIES.index(entry) for entry in entries]

        def evaluate(model: vgtjax.Actuator) -> np.ndarray:
            values = pack(model)
            return np.asarray(derivatives(values[where], values, begin(values, self._trace)))

        return evaluate

    @property
    def steps(self) -> int:
        """Steps of the last simulation."""
        return sum(int(plant.stats()["nsteps"]) for plant, _ in self._stretches)
