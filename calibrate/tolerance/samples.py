"""The file that holds the samples of a tolerance study."""

import contextlib
import itertools
import pathlib
import zipfile
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..output.files import replacing
from ..population import ChunkStore, Plan, scaled

CURVES = 4096
"""Samples whose curves are kept, for envelopes; numbers are kept of all samples."""


def write_samples(path: pathlib.Path, plan: Plan, store: ChunkStore) -> None:
    """All samples and what came of them, in parts, so that memory does not grow with their number.

    `values (samples, quantities)` in SI units by `quantities`; `outputs (samples, numbers)` in `output_units` by
    `output_names`; `failed` row numbers; every curve by its name, `(first samples, points)`, with its `axis_` array.
    """
    numbers, population = store.numbers, plan.job.population
    spans = [store.span(number) for number in range(store.count)]
    with _array_file(path) as add:
        add("quantities", [np.array(population.factors.entries)])
        add("quantity_units", [np.array(population.factors.units(population.model))])
        add("values", (population.values(plan.sample.points(*span)) for span in spans), store.rows)
        add("output_names", [np.array([output.name for output in numbers])])
        add("output_units", [np.array([scaled(output).unit for output in numbers])])
        scale = np.array([scaled(output).factor for output in numbers])
        add("outputs", (store.matrix(numbers, *span) * scale for span in spans), store.rows)
        add("failed", [np.array(list(store.failed()), int)])
        for output in store.outputs:
            if output.axis:
                add(f"axis_{output.name}", [np.array(output.axis) * scaled(output).axis_factor])
                add(output.name, [store[output.name] * scaled(output).factor])


@contextlib.contextmanager
def _array_file(path: pathlib.Path) -> Iterator[Callable[..., None]]:
    """A `.npz` file that is written array by array, each in parts along its first axis, whole or not at all."""
    with replacing(path) as new, zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:

        def add(name: str, parts: Iterable[np.ndarray], rows: int | None = None) -> None:
            rest = iter(parts)
            first = next(rest)
            shape = (len(first) if rows is None else rows, *first.shape[1:])
            header = {"descr": np.lib.format.dtype_to_descr(first.dtype), "fortran_order": False, "shape": shape}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, header)
                for part in itertools.chain([first], rest):
                    file.write(np.ascontiguousarray(part).tobytes())

        yield add
