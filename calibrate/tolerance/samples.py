"""The file that holds the samples of a tolerance study."""

import os
import pathlib
import zipfile
from collections.abc import Iterable

import numpy as np

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
    with ArrayFile(path) as file:
        file.add("quantities", np.array(population.factors.entries))
        file.add("quantity_units", np.array(population.factors.units(population.model)))
        values = (population.values(plan.sample.points(*span)) for span in spans)
        file.add_parts("values", (store.rows, population.dimensions), np.dtype(float), values)
        file.add("output_names", np.array([output.name for output in numbers]))
        file.add("output_units", np.array([scaled(output).unit for output in numbers]))
        scale = np.array([scaled(output).factor for output in numbers])
        rows = (store.matrix(numbers, *span) * scale for span in spans)
        file.add_parts("outputs", (store.rows, len(numbers)), np.dtype(float), rows)
        file.add("failed", np.array(list(store.failed()), int))
        for output in store.outputs:
            if output.axis:
                file.add(f"axis_{output.name}", np.array(output.axis) * scaled(output).axis_factor)
                file.add(output.name, store[output.name] * scaled(output).factor)


class ArrayFile:
    """A `.npz` file that is written array by array and part by part, whole or not at all."""

    def __init__(self, path: pathlib.Path):
        self._path, self._temporary = path, path.with_name(f".{path.name}.new")

    def __enter__(self) -> "ArrayFile":
        self._zip = zipfile.ZipFile(self._temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        self._zip.close()
        if kind is None:
            os.replace(self._temporary, self._path)

    def add(self, name: str, array: np.ndarray) -> None:
        """Writes an array at once."""
        self.add_parts(name, array.shape, array.dtype, [array])

    def add_parts(self, name: str, shape: tuple[int, ...], dtype: np.dtype, parts: Iterable[np.ndarray]) -> None:
        """Writes an array from parts along its first axis."""
        header = {"descr": np.lib.format.dtype_to_descr(np.dtype(dtype)), "fortran_order": False, "shape": shape}
        with self._zip.open(f"{name}.npy", "w", force_zip64=True) as file:
            np.lib.format.write_array_header_1_0(file, header)
            for part in parts:
                file.write(np.ascontiguousarray(part, dtype).tobytes())
