"""The samples of a tolerance study, and the file that holds them."""

import os
import pathlib
import zipfile
from collections.abc import Iterable

import numpy as np

from vgtjax.experiments import Output
from vgtjax.sensitivity import LatinHypercubeSample, Sample, SobolSample

from ..population import ChunkStore, PopulationJob, scaled

CURVES = 4096
"""Samples whose curves are kept, for envelopes; numbers are kept of all samples."""


def choose_sample(job: PopulationJob) -> Sample:
    """The sample that a study asks for."""
    table = job.study.tolerance
    kinds = {"sobol": SobolSample, "latin-hypercube": LatinHypercubeSample}
    return kinds[table.sampler](job.population.dimensions, table.samples, table.seed)


def write_samples(
    path: pathlib.Path, job: PopulationJob, sample: Sample, store: ChunkStore, outputs: tuple[Output, ...]
) -> None:
    """All samples and what came of them, in parts, so that memory does not grow with their number.

    `values (samples, quantities)` in SI units by `quantities`; `outputs (samples, numbers)` in `output_units` by
    `output_names`; `failed` row numbers; every curve by its name, `(first samples, points)`, with its `axis_` array.
    """
    numbers = [output for output in outputs if not output.axis]
    spans = [store.span(number) for number in range(store.count)]
    factors = job.population.factors
    with ArrayFile(path) as file:
        file.add("quantities", np.array(factors.entries))
        file.add("quantity_units", np.array(factors.units(job.population.model)))
        values = (job.population.values(sample.points(*span)) for span in spans)
        file.add_parts("values", (store.rows, job.population.dimensions), np.dtype(float), values)
        file.add("output_names", np.array([output.name for output in numbers]))
        file.add("output_units", np.array([scaled(output).unit for output in numbers]))
        scale = np.array([scaled(output).factor for output in numbers])
        rows = (store.table([output.name for output in numbers], *span) * scale for span in spans)
        file.add_parts("outputs", (store.rows, len(numbers)), np.dtype(float), rows)
        file.add("failed", store.failed())
        for output in outputs:
            if output.axis:
                file.add(f"axis_{output.name}", np.array(output.axis) * scaled(output).axis_factor)
                file.add(output.name, curve_rows(store, output) * scaled(output).factor)


def curve_rows(store: ChunkStore, output: Output) -> np.ndarray:
    """A curve of the first samples, `(samples, points)`, in SI units."""
    names = [f"{output.name}[{place}]" for place in range(output.size)]
    return store.table(names, 0, min(store.rows, CURVES))


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
