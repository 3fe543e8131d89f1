"""Everything that a simulation may report, by the names of the trace columns, with its unit."""

SIGNAL_UNITS = {
    "x_p": "m",
    "v_p": "m/s",
    "i": "A",
    "x_d": "m",
    "v_d": "m/s",
    "z": "m",
    "f_vane": "N",
    "T_act": "K",
    "p_act": "Pa absolute",
    "m_dot_in": "kg/s",
    "m_dot_out": "kg/s",
    "m_dot_line": "kg/s",
    "f_drive": "N",
}
"""`x_p, v_p` plunger; `i` coil current; `x_d, v_d` diaphragm; `z` bristles; `f_vane` exhaust gas on the vanes;
`T_act, p_act` chamber; `m_dot_in` from the atmosphere, `m_dot_out` to the reservoir, `m_dot_line` out of the line."""
