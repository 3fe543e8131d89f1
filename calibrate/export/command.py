"""The command `export`: writes the results of a fit as one file for other tools."""

import datetime
import functools
import importlib.metadata
import pathlib
from collections.abc import Callable
from typing import Literal

from vgtjax import InputError

from ..fmu.controller import controller_unit
from ..fmu.package import to_fmu
from ..fmu.plant import plant_unit
from ..output.console import console
from ..output.files import replacing
from ..study.characteristics import to_cdfx, to_dcm
from ..tune.gains_file import find_gains, load_controller
from .data_set import to_data_set
from .results import Results, read_results
from .tables import to_csv, to_mat

Format = Literal["csv", "cdfx", "dcm", "mat", "fmu"]

WRITERS: dict[Format, Callable[[Results, str, str], bytes]] = {
    "csv": to_csv,
    "cdfx": lambda *given: to_cdfx(to_data_set(*given)),
    "dcm": lambda *given: to_dcm(to_data_set(*given)),
    "mat": to_mat,
    "fmu": lambda results, *given: to_fmu(plant_unit(results.model), f"vgtjax {results.study.model}", *given),
}
"""Of results, the version of this package and a date."""


def run(results: pathlib.Path, kind: Format, out: pathlib.Path, date: datetime.datetime | None) -> None:
    """Writes one file, whole or not at all, and never over another.

    **Raises:** `InputError` for results that neither a fit nor `tune` wrote, or a file that is there, has another
    ending or would lie in a file.
    """
    if out.suffix.lower() != f".{kind}":
        raise InputError(f"--out must end in .{kind}, as --format says, but it is {out.name}; rename it")
    if out.exists():
        raise InputError(f"{out} is there already; remove it, or choose another --out")
    above = next(each for each in out.parents if each.exists())
    if not above.is_dir():
        raise InputError(f"--out must lie in a folder, but {above} is a file; choose another --out")
    day = (date or datetime.datetime.now(datetime.UTC)).date().isoformat()
    write = _writer(results, kind)
    with console.status(f"writing {out.name}"):  # a compiler for other systems takes minutes when it is new
        content = write(importlib.metadata.version("vgtjax"), day)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as new:
        new.write_bytes(content)
    console.print(f"wrote {out}")


def _writer(results: pathlib.Path, kind: Format) -> Callable[[str, str], bytes]:
    """What gives the file, of a version of this package and a date."""
    gains = find_gains(results)
    if gains is None:
        return functools.partial(WRITERS[kind], read_results(results))
    if kind != "fmu":
        raise InputError(
            f"{gains.name} holds a controller, which is exported as fmu, but --format is {kind}; change it"
        )
    tuned = load_controller(gains)
    unit = controller_unit(tuned.controller, tuned.period)
    return functools.partial(to_fmu, unit, f"vgtjax {tuned.design}")
