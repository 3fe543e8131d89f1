"""The whole actuator [2.58, corrected] as SciPy integrates it, with Tables B.1 and B.2 as printed.

It shares nothing with the package but the equations, and is for numbers that the package is to meet. A run takes a
tenth of a second.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import scipy.integrate

PRINTED = {
    "m_p": 0.01,
    "k_mem": 2000.0,
    "k_s1": 2400.0,
    "b_p": 22.0,
    "A_act": 1.7425e-4,
    "A_atm": 1.7652e-4,
    "A_res": 3.1416e-6,
    "magnet": (2.1731e-2, 2.2634e-3, 3.9e-3, -3.5733e-5, 9.1355e-8),
    "slope": 0.360e-3,
    "saturation": 2.5e-3,
    "orifice": (2.299e-8, 1.68e-4, 0.342),
    "V_0": 60e-6,
    "m_d": 0.63,
    "A_d": 2.9224e-3,
    "F_0": 49.46,
    "k_sm": 12_000.0,
    "travel": 10.13e-3,
    "F_s": 3.2,
    "F_c": 2.8,
    "sigma_0": 43_135.0,
    "sigma_1": 429.77,
    "sigma_2": 206.0,
    "v_s": 1e-3,
}
"""SI, from the print; the magnetic force over percent as (B.1) has it, and 206 N s/m once."""
P_ATM, T_ATM, R, GAMMA, P_RES = 101_013.0, 293.15, 286.7, 1.396, 2e4
"""Of Table B.2 but the last, Pa absolute, which is assumed as everywhere in this package."""
K_STOP, D_STOP = 1e6, 20.0
"""N/m and s/m, of stops that the thesis does not have."""
USUAL = np.array([1e-3, 0.1, 1e-2, 0.1, 1e-4, 3e2, 1e5])
"""Sizes of the states."""


def phi(ratio: float) -> float:
    """Flow function (2.15), corrected."""
    ratio = max(min(ratio, 1.0), (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1)))
    return math.sqrt(2 / (GAMMA - 1) * max(ratio ** (2 / GAMMA) - ratio ** ((GAMMA + 1) / GAMMA), 0.0))


@dataclasses.dataclass(frozen=True)
class Run:
    """Signals over `time` in s, pressure in Pa absolute, what goes `out` to the reservoir in kg/s; and the state at the
    end."""

    time: np.ndarray
    lift: np.ndarray
    position: np.ndarray
    temperature: np.ndarray
    pressure: np.ndarray
    out: np.ndarray
    end: np.ndarray

    def time_to(self, signal: str, fraction: float = 0.63) -> float:
        """Seconds after which a signal has made a fraction of its way."""
        values = getattr(self, signal)
        way = (values - values[0]) / (values[-1] - values[0])
        after = int(np.argmax(way >= fraction))
        return float(np.interp(fraction, way[after - 1 : after + 1], self.time[after - 1 : after + 1]))


@dataclasses.dataclass(frozen=True)
class Plant:
    """Other `values` may be given for those of `PRINTED`.

    With `isothermal` air keeps the temperature of the atmosphere; a `light` plunger is at rest at every moment. The
    jump of (B.3) opens over a `width` in m.
    """

    values: Mapping[str, object] = dataclasses.field(default_factory=dict)
    isothermal: bool = False
    light: bool = False
    reservoir: float = P_RES
    width: float = 1e-6

    def pull(self, duty: float) -> float:
        """N at a duty in percent [B.1]."""
        a, b, c, d, e = self._of("magnet")
        return (((e * duty + d) * duty + c) * duty + b) * duty + a

    def balance(self, duty: float) -> float:
        """Pa absolute at which the closed plunger balances [2.8], whether there is such a pressure or not."""
        push = P_ATM * self._of("A_atm") - self.reservoir * self._of("A_res") - self.pull(duty)
        return push / self._of("A_act")

    def steady_flow(self, duty: float, pressure: float) -> float:
        """kg/s into a chamber at the temperature of the atmosphere, once the plunger rests."""
        return self._flow(self._rest(pressure, self.pull(duty)), T_ATM, pressure)[0]

    def at_rest(self) -> np.ndarray:
        """Without duty, at atmosphere, pressed into the open stop."""
        lift = self._rest(P_ATM, self.pull(0.0))
        return np.array([lift, 0.0, -self._of("F_0") / (self._of("k_sm") + K_STOP), 0.0, 0.0, T_ATM, P_ATM])

    def run(
        self, duty: float, seconds: float, begin: np.ndarray | None = None, to: float | None = None, interval=1e-3
    ) -> Run:
        """A duty in percent, held, or on its straight way `to` another one."""
        steps = round(seconds / interval)
        time = np.arange(steps + 1) * interval
        slope = 0.0 if to is None else (to - duty) / time[-1]
        found = scipy.integrate.solve_ivp(
            self._rates,
            (0.0, time[-1]),
            self.at_rest() if begin is None else begin,
            "LSODA",
            time,
            args=(duty, slope),
            rtol=1e-6,
            atol=1e-8 * USUAL,
            max_step=0.1,  # else a step from rest misses where the plunger opens
        )
        assert found.success, found.message
        lift, _, position, _, _, temperature, pressure = found.y[:, :-1]
        time = time[:-1]
        if self.light:
            pulls = self.pull(duty + slope * time)
            lift = np.array([self._rest(*each) for each in zip(pressure, pulls, strict=True)])
        flows = np.array([self._flow(*each)[0] for each in zip(lift, temperature, pressure, strict=True)])
        return Run(time, lift, position, temperature, pressure, np.where(lift < 0, -flows, 0.0), found.y[:, -1])

    def step(self, duty: float, rest: float, held: float, released: float) -> Run:
        """At rest, under a duty, and after its release, for so many seconds each."""
        up = self.run(duty, held)
        down = self.run(0.0, released, begin=up.end)
        lift, _, position, _, _, temperature, pressure = self.at_rest()
        before = {"lift": lift, "position": position, "temperature": temperature, "pressure": pressure, "out": 0.0}
        signals = {
            name: np.concatenate([np.full(round(rest / 1e-3), value), getattr(up, name), getattr(down, name)])
            for name, value in before.items()
        }
        return Run(np.arange(len(signals["lift"])) * 1e-3, **signals, end=down.end)

    def _of(self, name: str):
        return self.values.get(name, PRINTED[name])

    def _rest(self, pressure: float, pull: float) -> float:
        of = self._of
        force = P_ATM * of("A_atm") - self.reservoir * of("A_res") - pull - pressure * of("A_act")
        return force / (of("k_mem") + of("k_s1") if force > 0 else of("k_mem"))

    def _flow(self, lift: float, temperature: float, pressure: float) -> tuple[float, float]:
        """kg/s into the chamber, and the temperature in K that it has."""
        if lift < 0:
            area, source = self._of("slope") * min(-lift, self._of("saturation")), self.reservoir
        else:
            c0, c1, c2 = self._of("orifice")
            area, source = c0 * min(lift / self.width, 1.0) + (c1 + c2 * lift) * lift, P_ATM
        if source > pressure:
            return area * source * math.sqrt(GAMMA / (R * T_ATM)) * phi(pressure / source), T_ATM
        hot = T_ATM if self.isothermal else temperature
        return -area * pressure * math.sqrt(GAMMA / (R * hot)) * phi(source / pressure), hot

    def _rates(self, time: float, y: np.ndarray, duty: float, slope: float) -> list[float]:
        x_p, v_p, x_d, v_d, z, temperature, pressure = y.tolist()
        of, pull = self._of, self.pull(duty + slope * time)
        lift = self._rest(pressure, pull) if self.light else x_p
        flow, hot = self._flow(lift, temperature, pressure)
        springs = of("k_mem") * x_p + of("k_s1") * max(x_p, 0.0)
        push = P_ATM * of("A_atm") - self.reservoir * of("A_res") - pull - pressure * of("A_act")
        plunger = (push - springs - of("b_p") * v_p) / of("m_p")
        volume = of("V_0") - of("A_d") * x_d
        gamma = 1.0 if self.isothermal else GAMMA
        rate = gamma * (R * hot * flow + pressure * of("A_d") * v_d) / volume
        # p V = m R T.
        mass = pressure * volume / (R * temperature)
        warmed = temperature * (rate / pressure - of("A_d") * v_d / volume - flow / mass)
        slide = of("sigma_0") * abs(v_d) * z / (of("F_c") + (of("F_s") - of("F_c")) * math.exp(-abs(v_d) / of("v_s")))
        force = (P_ATM - pressure) * of("A_d") - of("F_0") - of("k_sm") * x_d
        force -= of("sigma_0") * z + of("sigma_1") * (v_d - slide) + of("sigma_2") * v_d
        if x_d < 0:
            force -= K_STOP * x_d * max(1 - D_STOP * v_d, 0.0)
        elif x_d > of("travel"):
            force -= K_STOP * (x_d - of("travel")) * max(1 + D_STOP * v_d, 0.0)
        return [
            0.0 if self.light else v_p,
            0.0 if self.light else plunger,
            v_d,
            force / of("m_d"),
            v_d - slide,
            0.0 if self.isothermal else warmed,
            rate,
        ]
