"""Every signal that a trace may hold or a simulation reports, by name: unit, meaning, role, interpolation."""

import dataclasses
from typing import Literal


@dataclasses.dataclass(frozen=True)
class Signal:
    """What is known of a signal by its name.

    `role`: an `input` drives a model; what is `measured` is compared with it, and may drive half of one; a `state`
    (or flow) is only ever simulated. Between two samples a signal is linear, or `held` at the first.
    """

    unit: str
    """SI unit, as headers state it."""
    meaning: str
    role: Literal["input", "measured", "state"]
    held: bool = False


SIGNALS = {
    "pwm": Signal("%", "duty cycle", "input", held=True),
    "p_res": Signal("Pa absolute", "reservoir pressure", "input"),
    "p_trb": Signal("Pa gauge", "turbine inlet pressure", "input"),
    "x_drive": Signal("m", "position that drives the pneumatic model, free of offset and noise", "input"),
    "x_p": Signal("m", "position of the plunger", "state"),
    "v_p": Signal("m/s", "velocity of the plunger", "state"),
    "i": Signal("A", "coil current", "state"),
    "x_d": Signal("m", "position of the diaphragm", "measured"),
    "v_d": Signal("m/s", "velocity of the diaphragm", "state"),
    "z": Signal("m", "deflection of the bristles", "state"),
    "f_vane": Signal("N", "force of the exhaust gas on the vanes", "measured"),
    "T_act": Signal("K", "chamber temperature", "state"),
    "p_act": Signal("Pa absolute", "chamber pressure, an input of the mechanical model", "measured"),
    "m_dot_in": Signal("kg/s", "flow from the atmosphere", "state"),
    "m_dot_out": Signal("kg/s", "flow to the reservoir", "state"),
    "m_dot_line": Signal("kg/s", "flow out of the line", "state"),
    "f_drive": Signal("N", "force along +x that drives the mechanical model instead of a pressure", "input"),
}
"""In the order in which a simulation writes them."""
