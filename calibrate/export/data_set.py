"""From the results of a fit to a data set of characteristics."""

import numpy as np

import vgtjax
from vgtjax.parameters import table_row
from vgtjax.plants import converter_of

from ..study.characteristics import DERIVED, Characteristic, DataSet
from .results import ExportedEntry, Results

DUTIES = np.linspace(0.0, 100.0, 21)
"""Percent."""


def to_data_set(results: Results, version: str, date: str) -> DataSet:
    """All parameters as characteristics; a vector whose entries differ in their units becomes a value for each."""
    table = vgtjax.parameter_table(results.model)
    knots = {axis for row in table.values() for axis in row.axes}
    found: list[Characteristic] = []
    for name, described in table.items():
        rows = results.rows_of(name)
        if len({row.unit for row in rows}) > 1:
            found += [_of_entry(results, row) for row in rows]
        else:
            found.append(_of_parameter(results, name, rows, described.axes, name in knots))
    found += _derived(results)
    found.sort(key=lambda each: not each.is_axis)  # some readers want axes before the maps that refer to them
    names = results.study.components.names()
    return DataSet(version, date, results.study.model, names, results.hashes, found)


def _derived(results: Results) -> list[Characteristic]:
    """The steady magnetic force over the duty, of which the parameters are only coefficients."""
    converter = converter_of(results.model)
    if converter is None:
        return []
    force = np.array([float(converter.magnetic_force.steady_pull(duty, 0.0)) for duty in DUTIES])
    duty, remarks = f"{DERIVED}duty", ("follows from the parameters of converter.magnetic_force",)
    return [
        Characteristic(duty, "duty cycle", "%", DUTIES, is_axis=True, remarks=remarks),
        Characteristic(f"{DERIVED}magnetic_force", "steady, plunger at zero", "N", force, (duty,), remarks=remarks),
    ]


def _of_entry(results: Results, row: ExportedEntry) -> Characteristic:
    return Characteristic(
        row.name,
        _long_name(results, row.name),
        row.unit,
        np.array(row.value),
        state=_state([row]),
        remarks=(_said(row),),
    )


def _of_parameter(
    results: Results, name: str, rows: list[ExportedEntry], axes: tuple[str, ...], is_axis: bool
) -> Characteristic:
    values = np.array([row.value for row in rows])
    if axes:
        values = values.reshape(len(results.rows_of(axes[0])), -1)
    elif rows[0].name == name:
        values = values[0]
    remarks = tuple(map(_said, rows)) if any(row.free for row in rows) else (f"{name}: held",)
    long_name = _long_name(results, name)
    return Characteristic(name, long_name, rows[0].unit, values, axes, is_axis, _state(rows), remarks)


def _long_name(results: Results, name: str) -> str:
    row = table_row(vgtjax.parameter_table(results.model), name)
    return f"{name} ({row.symbol})"


def _state(rows: list[ExportedEntry]) -> str:
    """`calibrated` is what the fit stands behind."""
    return "calibrated" if all(row.identifiable for row in rows) else "prelimcalibrated"


def _said(row: ExportedEntry) -> str:
    """What a fit knows of an entry."""
    if not row.free:
        return f"{row.name}: held"
    if row.std_error is None:
        return f"{row.name}: not determined"
    ends = "" if row.low is None or row.high is None else f", 95 % from {row.low!r} to {row.high!r} {row.unit}"
    doubt = "" if row.identifiable else ", not determined"
    return f"{row.name}: standard error {row.std_error!r} {row.unit}{ends}{doubt}"
