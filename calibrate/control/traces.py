"""Closed loops as CSV files, to look at."""

import re

from vgtjax.tuning import Case, ClosedLoops

from ..output.files import columns_csv

ROWS = 10_000
"""At most so many rows a file: a run of a minute has every sixth sample."""


def trace_name(number: int, label: Case) -> str:
    """The file of a closed loop; its number tells apart what letters of file names can't."""
    text = re.sub(r"[^\w-]+", "_", f"{label.plant}_{label.course}")
    return f"{number:03d}_{text}_{label.turbine_pressure / 100:g}mbar.csv"


def trace_csv(group: ClosedLoops, index: int) -> str:
    """One closed loop as text."""
    runs = group.runs
    every = slice(None, None, -(-len(runs.time) // ROWS))
    columns = {
        "time [s]": runs.time[every],
        "pwm [%]": runs.duty[index, every],
        "p_act [Pa absolute]": runs.pressure[index, every],
        "x_d [m]": runs.position[index, every],
        "reference [m]": runs.reference[index, every],
    }
    if runs.observed is not None:
        columns["observed [Pa absolute]"] = runs.observed[index, every]
    return columns_csv(columns)
